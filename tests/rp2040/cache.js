// The cache between the core and the flash that the code runs from (RP2040 datasheet, 2.6.3).
//
// 16 KB in two ways, lines of 8 bytes: 1024 sets, by bits 3 to 12 of the address. A hit costs
// nothing beyond the core's own cycles. A miss fetches the line from the W25Q080 or alike by EBh,
// "fast read quad I/O", in continuous mode, as embassy-rp's second-stage loader sets it up: 8 clocks
// for address and mode on four lines, 4 dummy clocks, 16 for the 8 bytes, together 28; and a clock of
// the flash is two of the core (62.5 MHz). The core stands still for these 56 cycles, if it is the whole line that comes.
//
// Nor does the datasheet say that a miss fetches both words of a line. The loader sets the SSI up for one word
// at a time (NDF = 0), so it may well fetch the word alone: 8, 4 and 8 clocks, and what it takes to ask, 44 cycles. A line
// that is run through costs 88 then. That is the dearer assumption, and the one here: every figure of the board's README is
// measured by it. `words = false` models whole lines; the load that is hardest for the cache is tried by both.
//
// The datasheet does not say which way a new line takes: here the one that was used longer ago. It
// does not say either whether the core may go on with the first half of a line of which both words come: here it may not.
// The counters (2.6.3.3) see the core's own accesses only, and what
// the core executes from one word, or line, in a row is one access here, where the chip counts each word. What the core
// fetches ahead is not modelled: a word, or line, is asked for when its first instruction is executed.

import { BasePeripheral } from 'rp2040js';

const WAYS = 2;
const SETS = 16384 / 8 / WAYS;
/** Cycles of the core that a line takes. */
export const LINE_CYCLES = 2 * (8 + 4 + 16);
/** Cycles of the core that a word takes by itself, with what it takes to ask for it. */
export const WORD_CYCLES = 2 * (8 + 4 + 8) + 4;

export class Cache {
  constructor() {
    /** What a miss costs, a word's or a line's. */
    this.lineCycles = WORD_CYCLES;
    /** What is fetched at once: a line of 8 bytes (3), or a word of it (2). */
    this.shift = 2;
    /** The line, or the word, that the core has executed from last: it is there. */
    this.latest = -1;
    /** Per way: which of its line's words are there. */
    this.there = new Uint8Array(SETS * WAYS);
    /** Since the reset, for the program. */
    this.total = { hits: 0, misses: 0 };
    /** Since the bench has asked last. */
    this.asked = { hits: 0, misses: 0 };
    /** Per set: the lines of its ways, the one used last first. */
    this.lines = new Int32Array(SETS * WAYS).fill(-1);
  }

  /** From now on words come one by one, or lines as a whole. */
  byWords(words) {
    this.shift = words ? 2 : 3;
    this.lineCycles = words ? WORD_CYCLES : LINE_CYCLES;
    this.flush();
  }

  /** The core executes from an address: the cycles for which it waits. */
  fetch(address) {
    this.latest = address >>> this.shift;
    return this.wait(address);
  }

  /** The core reads from an address. */
  read(address) {
    const line = address >>> 3;
    const running = this.shift === 3 ? this.latest : this.latest >> 1;
    // It may take the place of the code's line, or make it the older one: that is looked up again.
    if (line !== running && line % SETS === running % SETS) this.latest = -1;
    return this.wait(address);
  }

  /** What there was since this was asked last. */
  takeCounts() {
    const { total, asked } = this;
    this.asked = { ...total };
    return { hits: total.hits - asked.hits, misses: total.misses - asked.misses };
  }

  /** Nothing is there any more. */
  flush() {
    this.lines.fill(-1);
    this.latest = -1;
  }

  wait(address) {
    const { lines, there } = this;
    const line = address >>> 3;
    const wanted = this.shift === 3 ? 3 : 1 << ((address >>> 2) & 1);
    const first = (line % SETS) * WAYS;
    if (lines[first] !== line) {
      const [before, had] = [lines[first], there[first]];
      lines[first] = line;
      there[first] = lines[first + 1] === line ? there[first + 1] : 0;
      lines[first + 1] = before;
      there[first + 1] = had;
    }
    if (there[first] & wanted) {
      this.total.hits++;
      return 0;
    }
    there[first] |= wanted;
    this.total.misses++;
    return this.lineCycles;
  }
}

const FLUSH = 0x04, STAT = 0x08, CTR_HIT = 0x0c, CTR_ACC = 0x10, STREAM_CTR = 0x18;
/** The cache is flushed, and the stream's FIFO is empty. */
const READY = 0b011;

/** XIP_CTRL: the program's own look at the cache. */
export class CacheControl extends BasePeripheral {
  constructor(chip) {
    super(chip.rp, 'XIP_CTRL');
    this.cache = chip.core.cache;
    /** What the counters had when they were cleared. */
    this.cleared = { hits: 0, accesses: 0 };
  }

  get accesses() {
    return this.cache.total.hits + this.cache.total.misses;
  }

  readUint32(offset) {
    switch (offset) {
      case FLUSH: return 0;
      case STAT: return READY;
      case CTR_HIT: return this.cache.total.hits - this.cleared.hits;
      case CTR_ACC: return this.accesses - this.cleared.accesses;
      // Nothing is streamed.
      case STREAM_CTR: return 0;
    }
    return super.readUint32(offset);
  }

  writeUint32(offset, value) {
    switch (offset) {
      case FLUSH:
        if (value & 1) this.cache.flush();
        return;
      // Whatever is written clears them.
      case CTR_HIT: this.cleared.hits = this.cache.total.hits; return;
      case CTR_ACC: this.cleared.accesses = this.accesses; return;
    }
    super.writeUint32(offset, value);
  }
}
