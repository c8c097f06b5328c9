"""What lies at a path that a user names."""
import os
import stat

_OTHERS = ((stat.S_ISDIR, 'a folder'), (stat.S_ISFIFO, 'a pipe'), (stat.S_ISSOCK, 'a socket'),
           (stat.S_ISCHR, 'a device'), (stat.S_ISBLK, 'a device'))


def check_file(path, error_type):
    """Raise `error_type` where `path` is there but no file: reading a pipe or a device may wait for ever, or never end.

    An absent one is left to whoever opens it.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    for is_other, name in _OTHERS:
        if is_other(mode):
            advice = '' if name == 'a folder' else '; save what it gives to a file and name that'
            raise error_type(f'{path}: expected a file, and it is {name}{advice}')
