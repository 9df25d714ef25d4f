"""The history of a run as a file: blocks that can be read whatever ended the process.

In: what a block says (`block`: plain data and arrays by name).
Out: a file that grows by whole blocks, and the blocks again, up to the last that is whole.
Open first: `history_file` (writer and reader, what a torn end is); `columns` has how arrays of
numbers become few bytes without loss, `model_pieces` how models share what they have in common. A
record may be a stranger's: `untrusted` reads files within limits, `stored_model` loads models that
do no harm.
"""
