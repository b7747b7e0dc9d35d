"""Decompression within limits, so that no file can ask for all memory or for hours.

A compressed piece (a chunk of an MCAP file, a message, a whole file) says how large it is going
to be, or it is decompressed step by step: in either case it is refused as soon as it is too large.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import zstandard

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
#: Bytes of one decompressed chunk or message at most; no writer makes larger ones.
PIECE_LIMIT = 1 << 29
#: Decompressed bytes of a file for each byte of it at most, beyond the first FREE_BYTES. Recorded
#: events become 2 to 50 times as large.
RATIO_LIMIT = 1000
FREE_BYTES = 1 << 26
_BLOCK = 1 << 20


class BudgetError(ValueError):
    """A piece would be larger than it may be."""


class Budget:
    """How large everything in one file may become."""

    def __init__(self, file_size: int) -> None:
        """Begin with what a file of this size [bytes] may become."""
        self._limit = self._left = max(FREE_BYTES, RATIO_LIMIT * file_size)

    def spend(self, size: int) -> None:
        """Take so many bytes.

        Raises:
            BudgetError: The piece is too large, or too little is left for it.
        """
        if size > PIECE_LIMIT:
            raise BudgetError(f'it would become {size} bytes, at most {PIECE_LIMIT} are read')
        if size > self._left:
            raise BudgetError(
                f'it would become {size} bytes, where a file of this size may become {self._limit}'
            )
        self._left -= size

    def decompress(self, data: bytes, compression: str, size: int | None = None) -> bytes:
        """Return a decompressed piece.

        Args:
            data: The piece.
            compression: '' for none, `zstd` or `lz4`.
            size: Bytes that come out, as the container says; None where it does not, which
                only zstd can do without.

        Raises:
            BudgetError: It would be too large.
            ValueError, zstandard.ZstdError, RuntimeError: It is damaged, or of another size or
                compression.
        """
        if compression == 'zstd':
            found = zstandard.frame_content_size(data)
            if found < 0 and size is None:
                return self._decompress_stream(data)
            expected = found if size is None else size
            self.spend(max(found, expected))
            if found == 0 or (found < 0 and expected == 0):
                content = b''
            else:
                content = zstandard.ZstdDecompressor().decompress(data, expected)
        elif compression == 'lz4' and size is not None:
            content = self._decompress_lz4(data, size)
        elif compression:
            raise ValueError(f'expected compression zstd or lz4, got {compression!r}')
        else:
            content = data
        if size is not None and len(content) != size:
            raise ValueError(f'expected {size} bytes, got {len(content)}')
        return content

    def unpack(self, source: BinaryIO, target: BinaryIO) -> None:
        """Decompress a file compressed by zstd as far as that goes.

        Raises:
            BudgetError: It would be too large; there is what was decompressed before.
            zstandard.ZstdError: It is damaged; there is what came before that.
            OSError: It cannot be written.
        """
        reader = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
        while block := reader.read(_BLOCK):
            self.spend(len(block))
            target.write(block)

    def _decompress_stream(self, data: bytes) -> bytes:
        reader = zstandard.ZstdDecompressor().stream_reader(data)
        content = bytearray()
        while block := reader.read(_BLOCK):
            self.spend(len(block))
            content += block
        return bytes(content)

    def _decompress_lz4(self, data: bytes, size: int) -> bytes:
        import lz4.frame

        self.spend(size)
        decompressor = lz4.frame.LZ4FrameDecompressor()
        # One byte more than it may have, to see that it is longer.
        return bytes(decompressor.decompress(data, max_length=size + 1))


def first_bytes(path: Path, count: int) -> tuple[bytes, bool]:
    """Return how a file begins, decompressed, and whether it is compressed by zstd.

    Raises:
        OSError: It cannot be read.
    """
    with path.open('rb') as file:
        head = file.read(count)
        if not head.startswith(ZSTD_MAGIC):
            return head, False
        file.seek(0)
        try:
            return zstandard.ZstdDecompressor().stream_reader(file).read(count), True
        except zstandard.ZstdError:
            return b'', True
