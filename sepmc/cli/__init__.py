"""The command line: a file for each group of commands; `render` turns results into text."""
