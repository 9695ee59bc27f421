// What the board uses of the boot ROM and of the oscillator, and the flash that the code runs from.
//
// The ROM itself is not there: a call of one of its functions is carried out here. Public functions
// are found by a table of two-letter codes (RP2040 datasheet 2.8.3); looking into it is one of them.
// Programming clears bits, erasing sets a sector's, and both take the time of the Pico's W25Q16JV
// (data sheet revision I, 9.7). Contents survive resets and power cycles. Meanwhile nothing else
// happens but what the pins and machines do.
//
// RANDOMBIT (2.17.3) gives the bits of a generator that is the same at each run of a test, three ones
// to two zeros, as an oscillator whose duty cycle is off. On silicon they are the oscillator's.

const FLASH = 0x10000000;
const SECTOR = 4096;
const ERASE_CYCLES = 45_000 * 125;
const PAGE = 256;
const PAGE_CYCLES = 400 * 125;

const FUNCTION_TABLE = 0x14, LOOKUP = 0x18;
const TABLE_AT = 0x100, LOOKUP_AT = 0x200, FUNCTIONS_AT = 0x210;
const THUMB = 1;
const code = (letters) => letters.charCodeAt(0) | (letters.charCodeAt(1) << 8);

/** What each function does with the registers: cycles that it takes, and what it leaves. */
const FUNCTIONS = {
  IF: { cycles: () => 100, leave() {} },
  EX: { cycles: () => 1000, leave() {} },
  FC: { cycles: () => 100, leave() {} },
  C4: {
    cycles: (r) => r[2],
    leave(rom, r) {
      for (let i = 0; i < r[2] >>> 0; i += 4) rom.core.write32(r[0] + i, rom.core.read32(r[1] + i));
    },
  },
  RE: {
    writes: true,
    cycles: (r, rom) => Math.ceil((r[1] >>> 0) / SECTOR) * ERASE_CYCLES * rom.memory.eraseShare,
    leave(rom, r) {
      rom.change(r[0] >>> 0, r[1] >>> 0, () => 0xff);
    },
  },
  RP: {
    writes: true,
    cycles: (r) => Math.ceil((r[2] >>> 0) / PAGE) * PAGE_CYCLES,
    leave(rom, r) {
      const from = r[1] >>> 0;
      rom.change(r[0] >>> 0, r[2] >>> 0, (was, i) => was & rom.core.read8(from + i));
    },
  },
};
const CODES = Object.keys(FUNCTIONS);

/** What is the board's own of its flash: it outlives a chip. */
export class FlashMemory {
  constructor() {
    /** What was changed, by sector. */
    this.written = new Map();
    /** So many writes until the power goes within one; null: never. */
    this.cutAfter = null;
    this.onCut = null;
    /** How much of the data sheet's time an erase takes. */
    this.eraseShare = 1;
  }
}

export class Rom {
  constructor(chip, memory) {
    this.chip = chip;
    this.memory = memory;
    const { written } = memory;
    /** The power goes within this write. */
    this.tears = false;
    /** The cycle at which the function under way ends. */
    this.end = null;
    for (const [sector, bytes] of written) chip.rp.flash.set(bytes, sector);
    const words = new DataView(chip.rp.bootrom.buffer);
    words.setUint16(FUNCTION_TABLE, TABLE_AT, true);
    words.setUint16(LOOKUP, LOOKUP_AT | THUMB, true);
  }

  get core() {
    return this.chip.core;
  }

  /** Carries out the function at `pc`: whether there is one. */
  call(pc, r) {
    const { chip } = this;
    if (pc === LOOKUP_AT) {
      const index = CODES.findIndex((letters) => code(letters) === (r[1] & 0xffff));
      r[0] = index < 0 ? 0 : (FUNCTIONS_AT + 2 * index) | THUMB;
      chip.now += 50;
      r[15] = r[14] & ~1;
      return true;
    }
    const called = FUNCTIONS[CODES[(pc - FUNCTIONS_AT) / 2]];
    if (called === undefined) return false;
    this.end ??= chip.cycle + Math.ceil(called.cycles(r, this));
    if (chip.cycle < this.end) {
      chip.now = Math.min(Math.max(chip.limit, chip.now + 1), chip.now + this.end - chip.cycle);
      r[15] = pc;
      return true;
    }
    this.end = null;
    if (called.writes && this.cuts()) {
      this.tears = true;
      called.leave(this, r);
      this.memory.onCut?.();
      chip.limit = 0;
      return true;
    }
    called.leave(this, r);
    r[15] = r[14] & ~1;
    return true;
  }

  /** Whether the power goes within this write. */
  cuts() {
    const { memory } = this;
    if (memory.cutAfter === null) return false;
    if (memory.cutAfter-- > 0) return false;
    memory.cutAfter = null;
    return true;
  }

  /** Changes bytes of the flash; of a write that is torn every other one. */
  change(at, length, to) {
    const { flash } = this.chip.rp;
    for (let i = 0; i < length; i++) {
      if (!this.tears || i % 2 === 0) flash[at + i] = to(flash[at + i], i);
    }
    for (let sector = at - (at % SECTOR); sector < at + length; sector += SECTOR) {
      this.memory.written.set(sector, flash.slice(sector, sector + SECTOR));
    }
  }
}

/** Bytes of the flash that the code runs from. */
export function contents(chip, address, length) {
  return chip.rp.flash.subarray(address - FLASH, address - FLASH + length);
}

const RANDOMBIT = 0x1c;

/** The oscillator's bits outlive a chip: no two starts have the same. */
export class Noise {
  constructor(seed) {
    this.state = seed | 0 || 1;
    /** Null, or the bits that it gives over and over: a source that is broken. */
    this.stuck = null;
    this.count = 0;
  }

  bit() {
    if (this.stuck !== null) return this.stuck[this.count++ % this.stuck.length];
    let x = this.state;
    x ^= x << 13;
    x ^= x >>> 17;
    x ^= x << 5;
    this.state = x;
    return (x >>> 0) / 2 ** 32 < 0.6 ? 1 : 0;
  }
}

/** Puts the oscillator's bits into a chip. */
export function connectNoise(noise, oscillator) {
  const read = oscillator.readUint32;
  oscillator.readUint32 = (offset) =>
    offset === RANDOMBIT ? noise.bit() : read.call(oscillator, offset);
}
