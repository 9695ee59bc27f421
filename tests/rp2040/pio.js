// The PIO's state machines, in lockstep with the core.
//
// rp2040js runs its PIO on a timer of its own, one instruction a step. Here every machine knows
// the cycle at which its next instruction is due, and is run up to a cycle by a function that is
// generated from its program. The semantics are rp2040js's (which are the datasheet's, chapter 3)
// with these differences:
//
// * delays and clock dividers take their time (3.5.1, 3.5.5);
// * inputs pass two synchroniser flip-flops unless INPUT_SYNC_BYPASS says otherwise (3.5.6.3);
// * FIFOs can be joined (3.5.4.1);
// * a write to CTRL starts machines in the same cycle (3.5.1), and restarting keeps X, Y and PC;
// * RXSTALL stays set after a PUSH that found no room only until it is cleared (3.7, FDEBUG);
// * an abort of a DMA channel reads as done (2.5.5.3) while the channel is still busy (RP2040-E13), and
//   starts a channel that is enabled, and the one that it is chained to, again (RP2350-E5);
// * a word that a DMA channel waits for goes straight to memory: one transfer a word.
//
// EXEC as a destination of OUT and MOV, and an instruction that stalls when written to SMx_INSTR,
// are refused with an error.

import { FIFO } from 'rp2040js';
import { leap } from './leap.js';
import { FAR, SYNC_CYCLES } from './pins.js';

const SM_STRIDE = 0x18;
const CTRL = 0x000, FDEBUG = 0x008, IRQ = 0x030, IRQ_FORCE = 0x034, INPUT_SYNC_BYPASS = 0x038;
const RXF0 = 0x020, INSTR_MEM0 = 0x048, SM0_CLKDIV = 0x0c8;
const TXSTALL = 1 << 24, TXOVER = 1 << 16, RXUNDER = 1 << 8, RXSTALL = 1 << 0;
const AUTOPUSH = 1 << 16, AUTOPULL = 1 << 17, IN_RIGHT = 1 << 18, OUT_RIGHT = 1 << 19;
const JOIN_TX = 1 << 30, JOIN_RX = 1 << 31;
const DMA_EN = 1, DMA_INCR_READ = 1 << 4, DMA_INCR_WRITE = 1 << 5, DMA_RING_WRITE = 1 << 10;
const DMA_QUIET = 1 << 21, DMA_BUSY = 1 << 24;
const CHAN_ABORT = 0x444;
/** In which transfers on their way end behind an abort: the errata state no bound. */
const ABORT_CYCLES = 64;
const SRAM = 0x20000000, SRAM_END = 0x20042000;
const PIO_BASE = [0x50200000, 0x50300000];

/** Why a machine does not go on. */
const NO = 0, FULL = 1, EMPTY = 2;

const COMPILED = new Map();

export class Machine {
  constructor(chip, pio, index) {
    this.chip = chip;
    this.pio = pio;
    this.index = index;
    this.pins = chip.pins;
    this.sram32 = new Int32Array(chip.rp.sram.buffer);
    this.enabled = false;
    this.x = 0;
    this.y = 0;
    this.pc = 0;
    this.isr = 0;
    this.inCount = 0;
    this.osr = 0;
    this.outCount = 32;
    /** The cycle of the window at which the next instruction is due. */
    this.t = FAR;
    /** Where in the list of pin changes this machine is. */
    this.k = 0;
    this.stalled = NO;
    this.held = 0;
    this.heldDelay = 0;
    this.irqWait = false;
    /** Whether `run` stopped before something that the core could notice. */
    this.stopped = false;
    this.clockDivider = 0x10000;
    this.execCtrl = 0x1f << 12;
    this.shiftCtrl = 0b11 << 18;
    this.pinCtrl = 0x5 << 26;
    this.rxFIFO = new FIFO(4);
    this.txFIFO = new FIFO(4);
    this.dreqRx = pio.dreqRx[index];
    this.dreqTx = pio.dreqTx[index];
    this.channel = null;
    this.program = null;
    /** For leap.js: where a turn notes what it pushes, the loop known, how often none is looked for. */
    this.pushed = null;
    this.loop = null;
    this.leapless = 0;
    this.updateDMARx();
    this.updateDMATx();
  }

  // --- What the rest of rp2040js asks for ---

  get fifoStat() {
    const bits =
      (this.txFIFO.empty ? 1 << 24 : 0) |
      (this.txFIFO.full ? 1 << 16 : 0) |
      (this.rxFIFO.empty ? 1 << 8 : 0) |
      (this.rxFIFO.full ? 1 : 0);
    return bits << this.index;
  }

  updateDMATx() {
    const { dma } = this.chip.rp;
    if (this.txFIFO.full) dma.clearDREQ(this.dreqTx);
    else dma.setDREQ(this.dreqTx);
  }

  updateDMARx() {
    const { dma } = this.chip.rp;
    if (this.rxFIFO.empty || this.chip.areTransfersHeld) dma.clearDREQ(this.dreqRx);
    else dma.setDREQ(this.dreqRx);
  }

  writeFIFO(value) {
    if (this.txFIFO.full) {
      this.pio.fdebug |= TXOVER << this.index;
      return;
    }
    this.txFIFO.push(value);
    this.pio.txStall &= ~(TXSTALL << this.index);
    if (this.stalled === EMPTY) {
      this.stalled = NO;
      this.t = this.chip.now + 1;
    }
    this.updateDMATx();
    this.pio.checkInterrupts();
  }

  readFIFO() {
    if (this.rxFIFO.empty) {
      this.pio.fdebug |= RXUNDER << this.index;
      return 0;
    }
    const value = this.rxFIFO.pull();
    this.pio.rxStall &= ~(RXSTALL << this.index);
    if (this.stalled === FULL) {
      this.stalled = NO;
      this.rxFIFO.push(this.held);
      this.t = this.chip.now + 1 + this.heldDelay;
    }
    this.updateDMARx();
    this.pio.checkInterrupts();
    return value;
  }

  restart() {
    this.inCount = 0;
    this.outCount = 32;
    this.isr = 0;
    this.irqWait = false;
    if (this.stalled !== NO) {
      this.goOn();
      this.t = this.chip.now + 1;
    }
  }

  /** Whatever it waited for, it does not any more. */
  goOn() {
    this.stalled = NO;
    this.pio.rxStall &= ~(RXSTALL << this.index);
    this.pio.txStall &= ~(TXSTALL << this.index);
  }

  clkDivRestart() {}
  checkWait() {}

  readUint32(offset) {
    switch (offset) {
      case 0x00: return this.clockDivider;
      case 0x04: return this.execCtrl;
      case 0x08: return this.shiftCtrl;
      case 0x0c: return this.pc;
      case 0x10: return this.pio.instructions[this.pc];
      default: return this.pinCtrl;
    }
  }

  writeUint32(offset, value) {
    switch (offset) {
      case 0x00:
        this.clockDivider = value;
        break;
      case 0x04:
        this.execCtrl = value & 0x7fffffff;
        break;
      case 0x08:
        if ((this.shiftCtrl ^ value) & (JOIN_RX | JOIN_TX)) {
          this.rxFIFO = new FIFO(value & JOIN_RX ? 8 : value & JOIN_TX ? 0 : 4);
          this.txFIFO = new FIFO(value & JOIN_TX ? 8 : value & JOIN_RX ? 0 : 4);
          this.updateDMARx();
          this.updateDMATx();
        }
        this.shiftCtrl = value;
        break;
      case 0x10:
        this.execute(value & 0xffff);
        break;
      case 0x14:
        this.pinCtrl = value;
        break;
    }
    this.program = null;
  }

  // --- Running ---

  get divider() {
    const whole = this.clockDivider >>> 16;
    return whole ? whole + ((this.clockDivider >>> 8) & 0xff) / 256 : 65536;
  }

  get inBase() {
    return (this.pinCtrl >>> 15) & 31;
  }

  get jumpPin() {
    return (this.execCtrl >>> 24) & 31;
  }

  /**
   * Runs until a cycle. If `peek`, not into anything that the core or another machine could
   * notice, and without any effect but on the registers that `restore` brings back.
   */
  run(until, peek) {
    this.stopped = false;
    const program = (this.program ??= this.compile());
    if (this.chip.leaps) leap(this, program, until, peek);
    program(this, until, peek);
  }

  /** An instruction written to SMx_INSTR: at once, whatever the machine is at (3.5.7). */
  execute(op) {
    const { t, pc } = this;
    const { now } = this.chip;
    this.t = now;
    this.once(op)(this, now + 1, false);
    if (this.t === FAR) throw new Error(`an instruction written to SM${this.index}_INSTR stalls`);
    if (this.stalled !== NO && this.pc !== pc) this.goOn();
    else if (t === FAR || !this.enabled) {
      this.t = t;
      return;
    }
    this.t = now + 1;
  }

  compile() {
    const key = [
      this.divider,
      // All but the jump pin and the base of the inputs, which are looked up.
      this.execCtrl & 0x6001ff9f,
      this.shiftCtrl & 0x3fff0000,
      this.pinCtrl & ~(31 << 15),
      this.pio.inputSyncBypass,
      this.usesFlags ? this.index : 0,
      ...this.pio.instructions,
    ].join();
    let program = COMPILED.get(key);
    if (!program) {
      const cases = [];
      const top = (this.execCtrl >>> 12) & 31;
      const bottom = (this.execCtrl >>> 7) & 31;
      this.pio.instructions.forEach((op, pc) => {
        const next = pc === top ? bottom : (pc + 1) & 31;
        cases.push(`case ${pc}: {${emit(this, op, `pc = ${next};`)} break;}`);
      });
      program = generate(cases.join('\n'));
      COMPILED.set(key, program);
    }
    return program;
  }

  once(op) {
    const key = ['once', op, this.index, this.pio.inputSyncBypass, this.execCtrl & 0x6000001f, this.shiftCtrl, this.pinCtrl & ~(31 << 15)].join();
    let program = COMPILED.get(key);
    if (!program) {
      program = generate(`default: {${emit(this, op, '')} break;}`);
      COMPILED.set(key, program);
    }
    return program;
  }

  save() {
    this.saved = [
      this.x, this.y, this.pc, this.isr, this.inCount, this.osr, this.outCount, this.t, this.k, this.irqWait,
    ];
  }

  restore() {
    [
      this.x, this.y, this.pc, this.isr, this.inCount, this.osr, this.outCount, this.t, this.k, this.irqWait,
    ] = this.saved;
  }

  /** Whether a push is more than a word in memory. */
  get tellsPush() {
    const { channel } = this;
    return !this.fillsMemory || tells(channel);
  }

  /** Whether a channel takes what this machine pushes. */
  get fillsMemory() {
    const { channel } = this;
    return channel !== null && channel.treqValue === this.dreqRx && channel.active !== 0;
  }

  get isLive() {
    const enabled = this.pio.irq0IntEnable | this.pio.irq1IntEnable;
    if (enabled & (0x11 << this.index)) return true;
    const { dma } = this.chip.rp;
    for (const channel of dma.channels) {
      if (channel.treqValue === this.dreqTx && channel.active) return true;
      if (channel.treqValue === this.dreqRx && channel.ctrl & DMA_EN && tells(channel)) return true;
    }
    return this.usesFlags || this.drivesPins;
  }

  /** Whether it may change a pin, which another machine may look at: SET, OUT and side-set, where it has pins for them. */
  get drivesPins() {
    const { pinCtrl } = this;
    const [sets, outs, sides] = [(pinCtrl >>> 26) & 7, (pinCtrl >>> 20) & 63, pinCtrl >>> 29];
    const isOn = (op) => (op >>> 13 === 7 && sets) || (op >>> 13 === 3 && outs);
    return sides > 0 || this.pio.instructions.some(isOn);
  }

  /** Whether a program of this block sets, clears or waits for interrupt flags. */
  get usesFlags() {
    return this.pio.instructions.some((op) => op >>> 13 === 6 || (op & 0xe060) === 0x2040);
  }

  /** Whether what is pushed goes straight to memory. */
  get isFree() {
    const { channel } = this;
    return (
      channel !== null &&
      !this.chip.areTransfersHeld &&
      this.rxFIFO.used === 0 &&
      (channel.ctrl & (DMA_BUSY | DMA_EN)) === (DMA_BUSY | DMA_EN) &&
      channel.treqValue === this.dreqRx
    );
  }

  /** Pushes the same words so many times, fewer than the channel takes before it ends. */
  fill(words, times) {
    const { channel } = this;
    const { ringMask } = channel;
    const isRing = ringMask !== 0 && (channel.ctrl & DMA_RING_WRITE) !== 0;
    const total = words.length * times;
    // What the ring's next rounds would write over is not written.
    const written = isRing ? Math.min(total, (ringMask + 1) >>> 2) : total;
    const after = (at, count) =>
      isRing ? (at & ~ringMask) | ((at + 4 * count) & ringMask) : at + 4 * count;
    let at = after(channel.writeAddr, total - written);
    for (let n = total - written; n < total; n++) {
      this.sram32[(at - SRAM) >>> 2] = words[n % words.length];
      at = after(at, 1);
    }
    channel.writeAddr = at;
    channel.transCount -= total;
  }

  push(value) {
    this.pushed?.push(value);
    const { channel } = this;
    if (this.isFree) {
      const at = channel.writeAddr;
      this.sram32[(at - SRAM) >>> 2] = value;
      const { ringMask } = channel;
      channel.writeAddr =
        ringMask && channel.ctrl & DMA_RING_WRITE ? (at & ~ringMask) | ((at + 4) & ringMask) : at + 4;
      if (--channel.transCount === 0) finish(channel);
      return true;
    }
    if (this.rxFIFO.full) {
      this.pio.fdebug |= RXSTALL << this.index;
      return false;
    }
    this.rxFIFO.push(value);
    this.updateDMARx();
    this.pio.checkInterrupts();
    return true;
  }

  /** A push that waits for room. */
  hold(value, delay) {
    this.pio.rxStall |= RXSTALL << this.index;
    this.stalled = FULL;
    this.held = value;
    this.heldDelay = delay;
  }

  pull() {
    const value = this.txFIFO.pull();
    this.updateDMATx();
    this.pio.checkInterrupts();
    return value | 0;
  }

  starve(waits) {
    this.pio.fdebug |= TXSTALL << this.index;
    if (waits) {
      this.pio.txStall |= TXSTALL << this.index;
      this.stalled = EMPTY;
    }
  }

  drive(isDirection, value, base, count, t) {
    const { pio } = this;
    if (isDirection) pio.pinDirectionsChanged(value, base, count);
    else pio.pinValuesChanged(value, base, count);
    if (pio.pinValues !== pio.oldPinValues || pio.pinDirections !== pio.oldPinDirections) {
      this.chip.stamp = t;
      pio.checkChangedPins();
      this.chip.stamp = -1;
    }
  }

  flag(bit, value) {
    if (value) this.pio.irq |= bit;
    else this.pio.irq &= ~bit;
    this.pio.checkInterrupts();
  }

  refuse() {
    throw new Error('a PIO program executes data (OUT EXEC or MOV EXEC), which this emulator does not');
  }
}

function tells(channel) {
  return (
    !(channel.ctrl & DMA_QUIET) &&
    ((channel.dma.intEnable0 | channel.dma.intEnable1) & (1 << channel.index)) !== 0
  );
}

function finish(channel) {
  channel.ctrl &= ~DMA_BUSY;
  if (!(channel.ctrl & DMA_QUIET)) {
    channel.dma.intRaw |= 1 << channel.index;
    channel.dma.checkInterrupts();
  }
  if (channel.chainTo !== channel.index) channel.dma.channels[channel.chainTo]?.start();
}

function generate(cases) {
  return new Function(
    'FAR',
    `return (s, until, peek) => {
      let { x, y, pc, isr, inCount, osr, outCount, t, k } = s;
      const { at, levels, enabled, inverted } = s.pins;
      const base = s.inBase, jumpPin = s.jumpPin;
      let level = 0;
      L: while (t < until) switch (pc) {
        ${cases}
      }
      s.x = x; s.y = y; s.pc = pc; s.isr = isr; s.inCount = inCount; s.osr = osr;
      s.outCount = outCount; s.t = t; s.k = k;
    }`,
  )(FAR);
}

/** One instruction as JavaScript; `go` moves on to the next. */
function emit(s, op, go) {
  const kind = op >>> 13;
  const arg = op & 0xff;
  const divider = s.divider;
  const sideCount = (s.pinCtrl >>> 29) & 7;
  const optional = (s.execCtrl >>> 30) & 1;
  const field = (op >>> 8) & 31;
  const delay = field & ((1 << (5 - sideCount)) - 1);
  const took = `t += ${(1 + delay) * divider};`;
  const peek = (what) => `if (peek && ${what}) { s.stopped = true; break L; }`;
  const bypass = s.pio.inputSyncBypass;
  // Which change of the pins is the last one seen at t.
  const see =
    `while (at[k + 1] <= t - ${SYNC_CYCLES}) k++; level = (levels[k] & enabled) ^ inverted;` +
    (bypass ? ` level = (level & ${~bypass}) | (s.pins.read(t) & ${bypass});` : '');
  let code = '';
  if (sideCount && (!optional || field & 16)) {
    const count = sideCount - optional;
    const value = (field >>> (5 - sideCount)) & ((1 << count) - 1);
    code += `${peek('true')} s.drive(${(s.execCtrl >>> 29) & 1}, ${value}, ${(s.pinCtrl >>> 10) & 31}, ${count}, t);`;
  }

  const source = (which) => {
    switch (which) {
      case 0: return `(level >>> base | level << (32 - base))`;
      case 1: return 'x';
      case 2: return 'y';
      case 3: return '0';
      case 5: {
        const fifo = s.execCtrl & 16 ? 'rxFIFO' : 'txFIFO';
        return `(s.${fifo}.itemCount < ${s.execCtrl & 15} ? -1 : 0)`;
      }
      case 6: return 'isr';
      case 7: return 'osr';
      default: return '0';
    }
  };
  const outPins = (direction, value) =>
    `${peek('true')} s.drive(${direction}, ${value}, ${s.pinCtrl & 31}, ${(s.pinCtrl >>> 20) & 63}, t);`;

  switch (kind) {
    case 0: {
      const jump = `pc = ${arg & 31}`;
      const conditions = [
        'true', 'x === 0', 'x !== 0', 'y === 0', 'y !== 0', 'x !== y',
        '(level >>> jumpPin & 1) !== 0', `outCount < ${threshold(s, 25)}`,
      ];
      const condition = arg >> 5;
      if (condition === 0) return `${code}${jump}; ${took}`;
      if (condition === 6) code += see;
      const after = condition === 2 ? 'x = x - 1 | 0;' : condition === 4 ? 'y = y - 1 | 0;' : '';
      return `${code} if (${conditions[condition]}) ${jump}; else {${go}} ${after} ${took}`;
    }
    case 1: {
      const polarity = arg >> 7;
      const index = arg & 31;
      const which = (arg >> 5) & 3;
      if (which === 2) {
        const bit = 1 << irqNumber(index, s.index);
        return `${code} if (((s.pio.irq & ${bit}) !== 0) === ${polarity === 1}) {
          ${polarity ? `${peek('true')} s.flag(${bit}, false);` : ''} ${go} ${took}
        } else t += ${divider};`;
      }
      const pin = which === 0 ? `${index}` : `(${index} + base & 31)`;
      return `${code} ${see} if ((level >>> ${pin} & 1) === ${polarity}) { ${go} ${took} }
        else ${bypass ? `t += ${divider};` : `t = Math.min(Math.max(until, t + ${divider}), Math.max(at[k + 1] + ${SYNC_CYCLES}, t + ${divider}));`}`;
    }
    case 2: {
      const bits = arg & 31 || 32;
      const which = arg >> 5;
      if (which === 0) code += see;
      if (s.shiftCtrl & AUTOPUSH) {
        code += peek(`inCount + ${bits} >= ${threshold(s, 20)} && s.tellsPush`);
      }
      const v = source(which);
      if (bits === 32) code += `isr = ${v};`;
      else if (s.shiftCtrl & IN_RIGHT) code += `isr = isr >>> ${bits} | ${v} << ${32 - bits};`;
      else code += `isr = isr << ${bits} | ${v} & ${(1 << bits) - 1};`;
      code += `inCount = Math.min(32, inCount + ${bits});`;
      if (s.shiftCtrl & AUTOPUSH) {
        code += `if (inCount >= ${threshold(s, 20)}) {
          const word = isr; isr = 0; inCount = 0;
          if (!(peek || s.push(word))) { s.hold(word, ${delay * divider}); ${go} t = FAR; break L; }
        }`;
      }
      return `${code} ${go} ${took}`;
    }
    case 3: {
      const bits = arg & 31 || 32;
      const to = arg >> 5;
      if (to === 0 || to === 4) code += peek('true');
      if (s.shiftCtrl & AUTOPULL) {
        code += `if (outCount >= ${threshold(s, 25)}) {
          ${peek('true')}
          if (s.txFIFO.empty) { s.starve(true); t = FAR; break L; }
          osr = s.pull(); outCount = 0;
        }`;
      }
      if (bits === 32) code += 'const v = osr; osr = 0;';
      else if (s.shiftCtrl & OUT_RIGHT) {
        code += `const v = osr & ${(1 << bits) - 1}; osr = osr >>> ${bits};`;
      } else code += `const v = osr >>> ${32 - bits}; osr = osr << ${bits};`;
      code += `outCount = Math.min(32, outCount + ${bits});`;
      switch (to) {
        case 0: code += outPins(0, 'v'); break;
        case 1: code += 'x = v | 0;'; break;
        case 2: code += 'y = v | 0;'; break;
        case 4: code += outPins(1, 'v'); break;
        case 5: return `${code} pc = v & 31; ${took}`;
        case 6: code += `isr = v | 0; inCount = ${bits};`; break;
        case 7: code += 's.refuse();'; break;
      }
      return `${code} ${go} ${took}`;
    }
    case 4: {
      const blocks = arg & 32;
      const conditional = arg & 64;
      if (arg & 0x80) {
        const skip = conditional ? `outCount < ${threshold(s, 25)}` : 'false';
        return `${code} if (${skip}) { ${go} ${took} } else {
          ${peek('true')}
          if (s.txFIFO.empty) {
            s.starve(${blocks !== 0});
            ${blocks ? 't = FAR; break L;' : `osr = x; outCount = 0; ${go} ${took}`}
          } else { osr = s.pull(); outCount = 0; ${go} ${took} }
        }`;
      }
      const skip = conditional ? `inCount < ${threshold(s, 20)}` : 'false';
      return `${code} if (${skip}) { ${go} ${took} } else {
        ${peek('s.tellsPush')}
        const word = isr; isr = 0; inCount = 0;
        if (!(peek || s.push(word)) && ${blocks !== 0}) { s.hold(word, ${delay * divider}); ${go} t = FAR; break L; }
        ${go} ${took}
      }`;
    }
    case 5: {
      const which = arg & 7;
      if (which === 0) code += see;
      let v = source(which);
      const operation = (arg >> 3) & 3;
      if (operation === 1) v = `~${v}`;
      else if (operation === 2) v = `s.reverse(${v})`;
      switch (arg >> 5) {
        case 0: code += outPins(0, v); break;
        case 1: code += `x = ${v} | 0;`; break;
        case 2: code += `y = ${v} | 0;`; break;
        case 4: code += 's.refuse();'; break;
        case 5: return `${code} pc = ${v} & 31; ${took}`;
        case 6: code += `isr = ${v} | 0; inCount = 0;`; break;
        case 7: code += `osr = ${v} | 0; outCount = 0;`; break;
      }
      return `${code} ${go} ${took}`;
    }
    case 6: {
      const bit = 1 << irqNumber(arg & 31, s.index);
      if (arg & 0x40) return `${code} ${peek('true')} s.flag(${bit}, false); ${go} ${took}`;
      if (!(arg & 0x20)) return `${code} ${peek('true')} s.flag(${bit}, true); ${go} ${took}`;
      return `${code} if (!s.irqWait) { ${peek('true')} s.flag(${bit}, true); s.irqWait = true; t += ${divider}; }
        else if (s.pio.irq & ${bit}) t += ${divider};
        else { s.irqWait = false; ${go} ${took} }`;
    }
    default: {
      const data = arg & 31;
      const base = (s.pinCtrl >>> 5) & 31;
      const count = (s.pinCtrl >>> 26) & 7;
      switch (arg >> 5) {
        case 0: code += `${peek('true')} s.drive(0, ${data}, ${base}, ${count}, t);`; break;
        case 1: code += `x = ${data};`; break;
        case 2: code += `y = ${data};`; break;
        case 4: code += `${peek('true')} s.drive(1, ${data}, ${base}, ${count}, t);`; break;
      }
      return `${code} ${go} ${took}`;
    }
  }
}

Machine.prototype.reverse = (x) => {
  let v = 0;
  for (let i = 0; i < 32; i++) v |= ((x >>> i) & 1) << (31 - i);
  return v;
};

function threshold(s, shift) {
  return (s.shiftCtrl >>> shift) & 31 || 32;
}

function irqNumber(index, machine) {
  return index & 16 ? (index & 4) | ((index + machine) & 3) : index & 7;
}

/** Takes over the PIO blocks and the DMA of a chip. */
export function install(chip) {
  const { rp } = chip;
  for (const pio of rp.pio) {
    pio.run = () => {};
    pio.machines = [0, 1, 2, 3].map((index) => new Machine(chip, pio, index));
    const read = pio.readUint32;
    pio.readUint32 = (offset) => {
      chip.synchronise();
      if (offset >= RXF0 && offset < RXF0 + 16) chip.disturb();
      return read.call(pio, offset);
    };
    const write = pio.writeUint32;
    pio.writeUint32 = (offset, value) => {
      chip.synchronise();
      if (offset === CTRL) control(chip, pio, value);
      else if (offset === FDEBUG) {
        pio.fdebug = (pio.fdebug & ~pio.rawWriteValue) | pio.txStall | pio.rxStall;
      } else write.call(pio, offset, value);
      if (offset === INPUT_SYNC_BYPASS || (offset >= INSTR_MEM0 && offset < SM0_CLKDIV)) {
        for (const machine of pio.machines) machine.program = null;
      }
      pio.checkChangedPins();
      chip.classify();
    };
  }
  const { dma } = rp;
  /** Aborts that were asked for; those that start a channel again; channels started before theirs was over. */
  chip.aborts = { asked: 0, again: 0, early: 0 };
  for (const channel of dma.channels) {
    const start = channel.start;
    channel.start = () => {
      if (channel.isAborting) chip.aborts.early++;
      start.call(channel);
      claim(chip, channel);
    };
    channel.abort = aborts(chip, channel);
  }
  const read = dma.readUint32;
  dma.readUint32 = (offset) => {
    chip.synchronise();
    return offset === CHAN_ABORT ? 0 : read.call(dma, offset);
  };
  const write = dma.writeUint32;
  dma.writeUint32 = (offset, value) => {
    chip.synchronise();
    write.call(dma, offset, value);
    chip.classify();
  };
}

/** CTRL: what starts with one write starts in one cycle. */
function control(chip, pio, value) {
  pio.machines.forEach((machine, index) => {
    const runs = (value & (1 << index)) !== 0;
    if (value & (0x10 << index)) machine.restart();
    if (runs && !machine.enabled && machine.stalled === NO) {
      machine.t = chip.now + 1;
      machine.k = 0;
    }
    machine.enabled = runs;
  });
}

/** An abort as the errata have it: what was enabled or chained when it was asked for goes on. */
function aborts(chip, channel) {
  let again = [];
  const over = chip.clock.createAlarm(() => {
    chip.synchronise();
    channel.isAborting = false;
    channel.ctrl &= ~DMA_BUSY;
    for (const started of again) started.start();
    chip.classify();
  });
  return () => {
    if ((channel.ctrl & DMA_BUSY) === 0) return;
    channel.transferAlarm.cancel();
    const { channels } = channel.dma;
    again = channel.ctrl & DMA_EN ? [channel] : [];
    if (channel.chainTo !== channel.index) again.push(channels[channel.chainTo]);
    channel.isAborting = true;
    chip.aborts.asked++;
    chip.aborts.again += again.length;
    over.at(chip.cycle + ABORT_CYCLES);
  };
}

/** A channel that copies words from a machine to memory gets them straight from it. */
function claim(chip, channel) {
  if (!channel.active || channel.dataSize !== 4) return;
  if ((channel.ctrl & (DMA_INCR_READ | DMA_INCR_WRITE)) !== DMA_INCR_WRITE) return;
  const block = PIO_BASE.indexOf(channel.readAddr - (channel.readAddr & 0xfffff));
  const index = ((channel.readAddr & 0xfff) - 0x20) >> 2;
  if (block < 0 || index < 0 || index > 3) return;
  const machine = chip.rp.pio[block].machines[index];
  if (channel.treqValue !== machine.dreqRx) return;
  const at = channel.writeAddr;
  const { ringMask } = channel;
  const ring = ringMask && channel.ctrl & DMA_RING_WRITE;
  const low = ring ? (at & ~ringMask) >>> 0 : at;
  const high = ring ? low + ringMask + 1 : at + 4 * channel.transCount;
  if (low < SRAM || high > SRAM_END) return;
  machine.channel = channel;
  chip.watch(low, high);
}
