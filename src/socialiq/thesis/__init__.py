"""The studies: each table and figure of the thesis made again, with the thesis' values beside."""
