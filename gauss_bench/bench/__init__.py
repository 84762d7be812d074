"""From cases to rows: isolated runs, interleaved timing, and the accuracy gate."""
