"""What nobody would mean, by lot: damaged linkage files and stored results, hostile arguments, stiff motions, kills, endless calls.

`python -m tests.fuzz --files 20000 --lists 3000 --seed 1` throws them at the command line's own function and tells every one that
ends otherwise than documented: with a traceback, with an exit code that is none of ours, later than a refusal may take, with a row
that is lost or doubled, or with memory that has grown.
"""
