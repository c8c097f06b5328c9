# SPDX-License-Identifier: Apache-2.0
"""Decompression of parts of bags up to a size limit, because `rosbags` unpacks parts of any size."""
from ...core.errors import RecordingError

LIMIT = 64 * 2**20
"""Maximum size of one unpacked chunk or message of a bag [bytes]."""


def limit_decompression():
    """Make `rosbags` unpack at most `LIMIT` bytes at a time for the rest of this process."""
    from bz2 import BZ2Decompressor
    from types import SimpleNamespace

    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader as rosbag1
    from rosbags.rosbag2 import reader as rosbag2
    from rosbags.rosbag2 import storage_mcap as mcap
    zstd = mcap.zstd
    unpack_lz4, unpack_zstd = limited(LZ4FrameDecompressor), limited(zstd.ZstdDecompressor)
    rosbag1.decompressors.update(bz2=limited(BZ2Decompressor), lz4=unpack_lz4)
    mcap.DECOMPRESSORS.update(lz4=unpack_lz4, zstd=unpack_zstd)
    rosbag2.zstd = SimpleNamespace(open=zstd.open, decompress=unpack_zstd)


def limited(decompressor):
    """Return a function that unpacks bytes with the streams that ``decompressor()`` makes.

    The function raises RecordingError when there are more than `LIMIT` unpacked bytes, or the packed bytes end too
    early.
    """

    def unpack(packed, _size=None):
        parts, rest = [], LIMIT
        while packed:
            stream = decompressor()
            parts.append(stream.decompress(packed, rest + 1))
            rest -= len(parts[-1])
            if rest < 0:
                raise RecordingError(f'a compressed part holds more than {LIMIT} bytes; expected chunks of a few MB')
            if not stream.eof:
                raise RecordingError('a compressed part ends too early')
            packed = stream.unused_data
        return b''.join(parts)

    return unpack
