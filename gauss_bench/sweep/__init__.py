"""One linkage with thousands of different numbers: from paths of its file to rows, quantiles and sensitivities."""
