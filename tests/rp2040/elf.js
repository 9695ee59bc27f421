// The loadable part of a 32-bit little-endian ELF file.

const PT_LOAD = 1;

/**
 * The segments that go into the chip, as [{ address, bytes }], at their physical addresses:
 * what a flasher would write.
 */
export function segments(file) {
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength);
  if (file.length < 52 || view.getUint32(0, false) !== 0x7f454c46 || file[4] !== 1) {
    throw new Error('the image is not a 32-bit ELF file');
  }
  const table = view.getUint32(28, true);
  const entrySize = view.getUint16(42, true);
  const count = view.getUint16(44, true);
  const found = [];
  for (let i = 0; i < count; i++) {
    const at = table + i * entrySize;
    const offset = view.getUint32(at + 4, true);
    const size = view.getUint32(at + 16, true);
    if (view.getUint32(at, true) === PT_LOAD && size > 0) {
      found.push({
        address: view.getUint32(at + 12, true),
        bytes: file.subarray(offset, offset + size),
      });
    }
  }
  return found;
}
