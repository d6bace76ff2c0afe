"""Robot descriptions as files: which files one may read, and the expansion of xacro.

Nothing here knows a robot library: the expansion runs in a process of its own, which must start in
a moment and in little memory.
"""
