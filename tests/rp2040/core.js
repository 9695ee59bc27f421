// The Cortex-M0+ of rp2040js, with its hot loop replaced.
//
// What is replaced and why:
//
// * `executeInstruction` walks a chain of some eighty comparisons per instruction. `run` below
//   does the same by a table, many instructions at a time, with the loads and stores to flash
//   and SRAM in line. Cycle counts are rp2040js's (Cortex-M0+ TRM, table 3-1).
// * Flags that rp2040js computes wrongly (ARMv6-M ARM, A6.7 and `AddWithCarry`): V of ADCS and
//   SBCS when the carry takes an operand over 0x7fff_ffff (signed 64-bit comparisons need it), C
//   of the register shifts by 0, by 32 and by more, C of RORS by 0.
// * SEV sets the event register (B1.5.18): an executor that is woken while it polls must not
//   sleep at the WFE that follows.
// * An interrupt that is masked by PRIMASK ends a WFI but is not taken (B1.5.19).
// * A software-pended interrupt is cleared when it is taken (B1.5.9), also for numbers that have
//   a line.
// * A pushed link register and a popped program counter take their cycle (TRM, table 3-1).
// * Exception entry takes 15 cycles and the return 13 (TRM 3.6), not none.
// * An access that is unaligned (A3.2.1), or where there is no memory, is a HardFault, not a log
//   line; so a stack that grows out of SRAM is seen.
//
// * Code and constants in flash come through the XIP cache (cache.js): a line that is not there
//   costs its wait states.
//
// Not modelled, here as there: wait states of the bus matrix.

import { Cache } from './cache.js';

const ENTRY_CYCLES = 15;
/** 13, less the 2 or 3 that the returning BX or POP costs by itself. */
const RETURN_CYCLES = 11;
const HARD_FAULT = 3;
const SRAM_SIZE = 264 * 1024;
/** Where the timer's raw time stands, the lower word (RP2040 datasheet 4.6.5). */
const TIMER_LOW = 0x40054028;
const CYCLES_PER_MICRO = 125;

let id = 0;
const ADCS = id++, ADD_R_SP = id++, ADD_SP = id++, ADDS_I3 = id++, ADDS_I8 = id++, ADDS_R = id++;
const ADD_HI = id++, ADR = id++, ANDS = id++, ASRS_I = id++, ASRS_R = id++, B_COND = id++, B = id++;
const BICS = id++, BKPT = id++, BLX = id++, BX = id++, CMN = id++, CMP_I = id++, CMP_R = id++;
const CMP_HI = id++, CPSID = id++, CPSIE = id++, EORS = id++, LDMIA = id++, LDR_I = id++;
const LDR_SP = id++, LDR_LIT = id++, LDR_R = id++, LDRB_I = id++, LDRB_R = id++, LDRH_I = id++;
const LDRH_R = id++, LDRSB = id++, LDRSH = id++, LSLS_I = id++, LSLS_R = id++, LSRS_I = id++;
const LSRS_R = id++, MOV = id++, MOVS = id++, MULS = id++, MVNS = id++, ORRS = id++, POP = id++;
const PUSH = id++, REV = id++, REV16 = id++, REVSH = id++, RORS = id++, RSBS = id++, NOP = id++;
const SBCS = id++, SEV = id++, STMIA = id++, STR_I = id++, STR_SP = id++, STR_R = id++;
const STRB_I = id++, STRB_R = id++, STRH_I = id++, STRH_R = id++, SUB_SP = id++, SUBS_I3 = id++;
const SUBS_I8 = id++, SUBS_R = id++, SVC = id++, SXTB = id++, SXTH = id++, TST = id++, UDF = id++;
const UXTB = id++, UXTH = id++, WFE = id++, WFI = id++, WIDE = id++, UNKNOWN = id++;

function decode(op) {
  switch (op >> 11) {
    case 0: return LSLS_I;
    case 1: return LSRS_I;
    case 2: return ASRS_I;
    case 3: return [ADDS_R, SUBS_R, ADDS_I3, SUBS_I3][(op >> 9) & 3];
    case 4: return MOVS;
    case 5: return CMP_I;
    case 6: return ADDS_I8;
    case 7: return SUBS_I8;
    case 8:
      if (op & 0x400) {
        return [ADD_HI, CMP_HI, MOV, op & 0x80 ? BLX : BX][(op >> 8) & 3];
      }
      return [ANDS, EORS, LSLS_R, LSRS_R, ASRS_R, ADCS, SBCS, RORS,
        TST, RSBS, CMP_R, CMN, ORRS, MULS, BICS, MVNS][(op >> 6) & 15];
    case 9: return LDR_LIT;
    case 10: return [STR_R, STRH_R, STRB_R, LDRSB][(op >> 9) & 3];
    case 11: return [LDR_R, LDRH_R, LDRB_R, LDRSH][(op >> 9) & 3];
    case 12: return STR_I;
    case 13: return LDR_I;
    case 14: return STRB_I;
    case 15: return LDRB_I;
    case 16: return STRH_I;
    case 17: return LDRH_I;
    case 18: return STR_SP;
    case 19: return LDR_SP;
    case 20: return ADR;
    case 21: return ADD_R_SP;
    case 24: return STMIA;
    case 25: return LDMIA;
    case 28: return B;
    case 29: case 30: case 31: return WIDE;
  }
  if (op >> 12 === 0b1101) {
    const cond = (op >> 8) & 15;
    return cond === 15 ? SVC : cond === 14 ? UDF : B_COND;
  }
  if (op >> 7 === 0b101100000) return ADD_SP;
  if (op >> 7 === 0b101100001) return SUB_SP;
  if (op >> 6 === 0b1011001000) return SXTH;
  if (op >> 6 === 0b1011001001) return SXTB;
  if (op >> 6 === 0b1011001010) return UXTH;
  if (op >> 6 === 0b1011001011) return UXTB;
  if (op >> 9 === 0b1011010) return PUSH;
  if (op >> 9 === 0b1011110) return POP;
  if (op >> 6 === 0b1011101000) return REV;
  if (op >> 6 === 0b1011101001) return REV16;
  if (op >> 6 === 0b1011101011) return REVSH;
  if (op === 0xb672) return CPSID;
  if (op === 0xb662) return CPSIE;
  if (op >> 8 === 0b10111110) return BKPT;
  if (op === 0xbf20) return WFE;
  if (op === 0xbf30) return WFI;
  if (op === 0xbf40) return SEV;
  if (op === 0xbf00 || op === 0xbf10) return NOP;
  return UNKNOWN;
}

const DECODED = Uint8Array.from({ length: 65536 }, (_, op) => decode(op));

export class Core {
  /** Takes over the core of `chip.rp`. */
  constructor(chip) {
    this.chip = chip;
    const core = chip.rp.core;
    this.core = core;
    this.registers = new Int32Array(core.registers.buffer);
    this.sram8 = chip.rp.sram;
    this.sram16 = new Uint16Array(chip.rp.sram.buffer);
    this.sram32 = new Int32Array(chip.rp.sram.buffer);
    this.flash8 = chip.rp.flash;
    this.flash16 = chip.rp.flash16;
    this.flash32 = new Int32Array(chip.rp.flash.buffer);
    this.cache = new Cache();
    /** Cycles of exceptions taken or left, not yet counted. */
    this.penalty = 0;
    this.instructions = 0;
    /**
     * Per interrupt: requested (-1: not), entered, the request of that entry (all cycles), how many, longest wait,
     * longest run, longest from a request to its return.
     */
    this.interrupts = Array.from({ length: 32 }, () => [-1, -1, -1, 0, 0, 0, 0]);
    /** Why the board stopped for good, if it did. */
    this.fault = null;
    /** When. */
    this.faultCycle = null;
    /** Whether the core stops where what it saves at a fault has no memory; else the handler begins without. */
    this.stopsWithoutStack = false;
    /** Where the handler of faults began. */
    this.handler = 0;
    // Interrupt lines, apart from what software has pended.
    core.lines = 0;
    core.pended = 0;
    core.sleepsUntilInterrupt = false;
    patchExceptions(this, core, chip.rp.ppb);
  }

  read32(address) {
    const a = address >>> 0;
    if (a & 3) return this.noAccess('unaligned access', a);
    if (a >>> 24 === 0x20) {
      const offset = a - 0x20000000;
      if (offset < SRAM_SIZE) {
        if (a >= this.chip.watchLow && a < this.chip.watchHigh) this.chip.synchronise();
        return this.sram32[offset >> 2];
      }
    } else if (a >>> 24 === 0x10) {
      this.chip.now += this.cache.read(a);
      return this.flash32[(a & 0xffffff) >> 2];
    }
    // Looked at more often than all other registers together, by whoever waits.
    if (a === TIMER_LOW) return Math.floor(this.chip.cycle / CYCLES_PER_MICRO) | 0;
    if (isNowhere(a)) return this.noAccess('no memory to read', a);
    return this.chip.rp.readUint32(a) | 0;
  }

  read16(address) {
    const a = address >>> 0;
    if (a & 1) return this.noAccess('unaligned access', a);
    if (a >>> 24 === 0x20) {
      const offset = a - 0x20000000;
      if (offset < SRAM_SIZE) {
        if (a >= this.chip.watchLow && a < this.chip.watchHigh) this.chip.synchronise();
        return this.sram16[offset >> 1];
      }
    } else if (a >>> 24 === 0x10) {
      this.chip.now += this.cache.read(a);
      return this.flash16[(a & 0xffffff) >> 1];
    }
    if (isNowhere(a)) return this.noAccess('no memory to read', a);
    return this.chip.rp.readUint16(a) & 0xffff;
  }

  read8(address) {
    const a = address >>> 0;
    if (a >>> 24 === 0x20) {
      const offset = a - 0x20000000;
      if (offset < SRAM_SIZE) {
        if (a >= this.chip.watchLow && a < this.chip.watchHigh) this.chip.synchronise();
        return this.sram8[offset];
      }
    } else if (a >>> 24 === 0x10) {
      this.chip.now += this.cache.read(a);
      return this.flash8[a & 0xffffff];
    }
    if (isNowhere(a)) return this.noAccess('no memory to read', a);
    return this.chip.rp.readUint8(a) & 0xff;
  }

  write32(address, value) {
    const a = address >>> 0;
    if (a & 3) return this.noAccess('unaligned access', a);
    if (a >>> 24 === 0x20) {
      const offset = a - 0x20000000;
      if (offset < SRAM_SIZE) {
        this.sram32[offset >> 2] = value;
        return 0;
      }
    }
    if (isNowhere(a) || a >>> 26 === 4) return this.noAccess('no memory to write', a);
    this.chip.rp.writeUint32(a, value >>> 0);
    return 0;
  }

  write16(address, value) {
    const a = address >>> 0;
    if (a & 1) return this.noAccess('unaligned access', a);
    if (a >>> 24 === 0x20) {
      const offset = a - 0x20000000;
      if (offset < SRAM_SIZE) {
        this.sram16[offset >> 1] = value;
        return 0;
      }
    }
    if (isNowhere(a) || a >>> 26 === 4) return this.noAccess('no memory to write', a);
    this.chip.rp.writeUint16(a, value & 0xffff);
    return 0;
  }

  write8(address, value) {
    const a = address >>> 0;
    if (a >>> 24 === 0x20) {
      const offset = a - 0x20000000;
      if (offset < SRAM_SIZE) {
        this.sram8[offset] = value;
        return 0;
      }
    }
    if (isNowhere(a) || a >>> 26 === 4) return this.noAccess('no memory to write', a);
    this.chip.rp.writeUint8(a, value & 0xff);
    return 0;
  }

  noAccess(what, address) {
    this.hardFault(`${what}: ${address.toString(16)}`);
    return 0;
  }

  /** Keeps the first. */
  note(fault) {
    this.fault ??= fault;
    this.faultCycle ??= this.chip.epoch + this.chip.cycle;
  }

  hardFault(what) {
    const at = (this.core.PC - 2) >>> 0;
    this.note(`${what} at ${at.toString(16)}`);
    if (this.core.IPSR !== HARD_FAULT) {
      this.core.exceptionEntry(HARD_FAULT);
      this.handler = this.registers[15];
    } else if (this.registers[15] !== this.handler) this.lockUp();
    // Else it is the same instruction, which has faulted already.
  }

  /** A fault out of nowhere, at the instruction that comes next. */
  crash() {
    this.core.waiting = false;
    this.hardFault('a fault that the bench asked for');
  }

  /** A fault in the handler of faults: nothing more until a reset (Armv6-M, B1.5.14). */
  lockUp() {
    this.core.waiting = true;
    this.core.PM = true;
    this.core.sleepsUntilInterrupt = false;
  }

  /**
   * Leaves so many bytes of the stack: what is on it is copied down, and its pointer follows.
   * False if the core does not wait outside of interrupts: then its registers may point there.
   */
  sinkStack(top, bottom, free) {
    const { core: c, registers: r } = this;
    if (!c.waiting || c.IPSR !== 0) return false;
    const to = bottom + free;
    const length = top - r[13];
    this.sram8.copyWithin(to - 0x20000000, r[13] - 0x20000000, r[13] - 0x20000000 + length);
    r[13] = to;
    return true;
  }

  /** Rows of number, how many, longest wait, run and both of one request since this was asked last. */
  takeInterruptTimes() {
    const rows = this.interrupts.map((times, irq) => [irq, ...times.slice(3)]);
    for (const times of this.interrupts) times.fill(0, 3);
    return rows.filter(([, count]) => count > 0);
  }

  /** Runs until `chip.limit` or until the core sleeps. */
  run() {
    const { chip, core: c, registers: r, sram16, flash16, cache } = this;
    let count = 0;
    while (chip.now < chip.limit) {
      if (c.interruptsUpdated) c.checkForInterrupts();
      if (this.penalty) {
        chip.now += this.penalty;
        this.penalty = 0;
      }
      count++;
      const pc = r[15] & ~1;
      let op;
      if (pc >>> 24 === 0x10) {
        if (pc >>> cache.shift !== cache.latest) chip.now += cache.fetch(pc);
        op = flash16[(pc & 0xffffff) >> 1];
      } else if (pc >>> 24 === 0x20) op = sram16[(pc & 0xfffff) >> 1];
      else if (chip.rom?.call(pc, r)) continue;
      else {
        this.note(`program counter outside memory: ${(pc >>> 0).toString(16)}`);
        c.waiting = true;
        c.PM = true;
        break;
      }
      r[15] = pc + 2;
      let cycles = 1;
      switch (DECODED[op]) {
        case LSLS_I: {
          const n = (op >> 6) & 31;
          const a = r[(op >> 3) & 7];
          const v = a << n;
          r[op & 7] = v;
          c.N = v < 0;
          c.Z = v === 0;
          if (n) c.C = ((a >>> (32 - n)) & 1) === 1;
          break;
        }
        case LSRS_I: {
          const n = (op >> 6) & 31;
          const a = r[(op >> 3) & 7];
          const v = n ? a >>> n : 0;
          r[op & 7] = v;
          c.N = false;
          c.Z = v === 0;
          c.C = ((a >>> (n ? n - 1 : 31)) & 1) === 1;
          break;
        }
        case ASRS_I: {
          const n = (op >> 6) & 31;
          const a = r[(op >> 3) & 7];
          const v = n ? a >> n : a >> 31;
          r[op & 7] = v;
          c.N = v < 0;
          c.Z = v === 0;
          c.C = ((a >>> (n ? n - 1 : 31)) & 1) === 1;
          break;
        }
        case ADDS_R: r[op & 7] = add(c, r[(op >> 3) & 7], r[(op >> 6) & 7]); break;
        case SUBS_R: r[op & 7] = subtract(c, r[(op >> 3) & 7], r[(op >> 6) & 7]); break;
        case ADDS_I3: r[op & 7] = add(c, r[(op >> 3) & 7], (op >> 6) & 7); break;
        case SUBS_I3: r[op & 7] = subtract(c, r[(op >> 3) & 7], (op >> 6) & 7); break;
        case MOVS: {
          const v = op & 0xff;
          r[(op >> 8) & 7] = v;
          c.N = false;
          c.Z = v === 0;
          break;
        }
        case CMP_I: subtract(c, r[(op >> 8) & 7], op & 0xff); break;
        case ADDS_I8: r[(op >> 8) & 7] = add(c, r[(op >> 8) & 7], op & 0xff); break;
        case SUBS_I8: r[(op >> 8) & 7] = subtract(c, r[(op >> 8) & 7], op & 0xff); break;
        case ANDS: logic(c, (r[op & 7] &= r[(op >> 3) & 7])); break;
        case EORS: logic(c, (r[op & 7] ^= r[(op >> 3) & 7])); break;
        case ORRS: logic(c, (r[op & 7] |= r[(op >> 3) & 7])); break;
        case BICS: logic(c, (r[op & 7] &= ~r[(op >> 3) & 7])); break;
        case MVNS: logic(c, (r[op & 7] = ~r[(op >> 3) & 7])); break;
        case TST: logic(c, r[op & 7] & r[(op >> 3) & 7]); break;
        case MULS: logic(c, (r[op & 7] = Math.imul(r[op & 7], r[(op >> 3) & 7]))); break;
        case LSLS_R: {
          const n = r[(op >> 3) & 7] & 0xff;
          const a = r[op & 7];
          if (n) c.C = n <= 32 && ((a >>> ((32 - n) & 31)) & 1) === 1;
          logic(c, (r[op & 7] = n < 32 ? a << n : 0));
          break;
        }
        case LSRS_R: {
          const n = r[(op >> 3) & 7] & 0xff;
          const a = r[op & 7];
          if (n) c.C = n <= 32 && ((a >>> (n - 1)) & 1) === 1;
          logic(c, (r[op & 7] = n < 32 ? (a >>> n) | 0 : 0));
          break;
        }
        case ASRS_R: {
          const n = r[(op >> 3) & 7] & 0xff;
          const a = r[op & 7];
          if (n) c.C = ((a >> Math.min(n - 1, 31)) & 1) === 1;
          logic(c, (r[op & 7] = a >> Math.min(n, 31)));
          break;
        }
        case RORS: {
          const n = r[(op >> 3) & 7] & 0xff;
          const m = n & 31;
          const a = r[op & 7];
          const v = m ? (a >>> m) | (a << (32 - m)) : a;
          if (n) c.C = v < 0;
          logic(c, (r[op & 7] = v));
          break;
        }
        case ADCS: r[op & 7] = addCarry(c, r[op & 7], r[(op >> 3) & 7], c.C ? 1 : 0); break;
        case SBCS: r[op & 7] = addCarry(c, r[op & 7], ~r[(op >> 3) & 7], c.C ? 1 : 0); break;
        case RSBS: r[op & 7] = subtract(c, 0, r[(op >> 3) & 7]); break;
        case CMP_R: subtract(c, r[op & 7], r[(op >> 3) & 7]); break;
        case CMN: add(c, r[op & 7], r[(op >> 3) & 7]); break;
        case ADD_HI: {
          const d = ((op & 0x80) >> 4) | (op & 7);
          const m = (op >> 3) & 15;
          const v = (d === 15 ? pc + 4 : r[d]) + (m === 15 ? pc + 4 : r[m]);
          if (d === 15) {
            r[15] = v & ~1;
            cycles = 2;
          } else r[d] = d === 13 ? v & ~3 : v;
          break;
        }
        case CMP_HI: subtract(c, r[((op >> 4) & 8) | (op & 7)], r[(op >> 3) & 15]); break;
        case MOV: {
          const d = ((op >> 4) & 8) | (op & 7);
          const m = (op >> 3) & 15;
          const v = m === 15 ? pc + 4 : r[m];
          if (d === 15) {
            r[15] = v & ~1;
            cycles = 2;
          } else r[d] = d === 13 ? v & ~3 : v;
          break;
        }
        case BX:
          cycles = 2;
          c.BXWritePC(r[(op >> 3) & 15] >>> 0);
          break;
        case BLX: {
          const target = r[(op >> 3) & 15];
          r[14] = (pc + 2) | 1;
          r[15] = target & ~1;
          cycles = 2;
          break;
        }
        case LDR_LIT:
          cycles = 2;
          r[(op >> 8) & 7] = this.read32(((pc + 4) & ~3) + ((op & 0xff) << 2));
          break;
        case LDR_I: {
          const a = r[(op >> 3) & 7] + ((op >> 4) & 0x7c);
          cycles = 1 + loadCycles(a);
          r[op & 7] = this.read32(a);
          break;
        }
        case LDR_R: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + loadCycles(a);
          r[op & 7] = this.read32(a);
          break;
        }
        case LDR_SP:
          cycles = 2;
          r[(op >> 8) & 7] = this.read32(r[13] + ((op & 0xff) << 2));
          break;
        case LDRB_I: {
          const a = r[(op >> 3) & 7] + ((op >> 6) & 31);
          cycles = 1 + loadCycles(a);
          r[op & 7] = this.read8(a);
          break;
        }
        case LDRB_R: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + loadCycles(a);
          r[op & 7] = this.read8(a);
          break;
        }
        case LDRH_I: {
          const a = r[(op >> 3) & 7] + ((op >> 5) & 0x3e);
          cycles = 1 + loadCycles(a);
          r[op & 7] = this.read16(a);
          break;
        }
        case LDRH_R: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + loadCycles(a);
          r[op & 7] = this.read16(a);
          break;
        }
        case LDRSB: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + loadCycles(a);
          r[op & 7] = (this.read8(a) << 24) >> 24;
          break;
        }
        case LDRSH: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + loadCycles(a);
          r[op & 7] = (this.read16(a) << 16) >> 16;
          break;
        }
        case STR_I: {
          const a = r[(op >> 3) & 7] + ((op >> 4) & 0x7c);
          cycles = 1 + storeCycles(a);
          this.write32(a, r[op & 7]);
          break;
        }
        case STR_R: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + storeCycles(a);
          this.write32(a, r[op & 7]);
          break;
        }
        case STR_SP:
          cycles = 2;
          this.write32(r[13] + ((op & 0xff) << 2), r[(op >> 8) & 7]);
          break;
        case STRB_I: {
          const a = r[(op >> 3) & 7] + ((op >> 6) & 31);
          cycles = 1 + storeCycles(a);
          this.write8(a, r[op & 7]);
          break;
        }
        case STRB_R: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + storeCycles(a);
          this.write8(a, r[op & 7]);
          break;
        }
        case STRH_I: {
          const a = r[(op >> 3) & 7] + ((op >> 5) & 0x3e);
          cycles = 1 + storeCycles(a);
          this.write16(a, r[op & 7]);
          break;
        }
        case STRH_R: {
          const a = r[(op >> 3) & 7] + r[(op >> 6) & 7];
          cycles = 1 + storeCycles(a);
          this.write16(a, r[op & 7]);
          break;
        }
        case ADR: r[(op >> 8) & 7] = ((pc + 4) & ~3) + ((op & 0xff) << 2); break;
        case ADD_R_SP: r[(op >> 8) & 7] = r[13] + ((op & 0xff) << 2); break;
        case ADD_SP: r[13] += (op & 0x7f) << 2; break;
        case SUB_SP: r[13] -= (op & 0x7f) << 2; break;
        case SXTH: r[op & 7] = (r[(op >> 3) & 7] << 16) >> 16; break;
        case SXTB: r[op & 7] = (r[(op >> 3) & 7] << 24) >> 24; break;
        case UXTH: r[op & 7] = r[(op >> 3) & 7] & 0xffff; break;
        case UXTB: r[op & 7] = r[(op >> 3) & 7] & 0xff; break;
        case REV: {
          const a = r[(op >> 3) & 7];
          r[op & 7] = (a << 24) | ((a & 0xff00) << 8) | ((a >>> 8) & 0xff00) | (a >>> 24);
          break;
        }
        case REV16: {
          const a = r[(op >> 3) & 7];
          r[op & 7] = ((a & 0x00ff00ff) << 8) | ((a >>> 8) & 0x00ff00ff);
          break;
        }
        case REVSH: {
          const a = r[(op >> 3) & 7];
          r[op & 7] = (((a & 0xff) << 24) >> 16) | ((a >>> 8) & 0xff);
          break;
        }
        case PUSH: {
          let bits = op & 0x1ff;
          let a = r[13] - 4 * ones(bits);
          r[13] = a;
          for (let i = 0; bits; i++, bits >>= 1) {
            if (bits & 1) {
              this.write32(a, r[i === 8 ? 14 : i]);
              a += 4;
              cycles++;
            }
          }
          break;
        }
        case POP: {
          let bits = op & 0xff;
          let a = r[13];
          for (let i = 0; bits; i++, bits >>= 1) {
            if (bits & 1) {
              r[i] = this.read32(a);
              a += 4;
              cycles++;
            }
          }
          if (op & 0x100) {
            const target = this.read32(a) >>> 0;
            r[13] = a + 4;
            cycles += 3;
            c.BXWritePC(target);
          } else r[13] = a;
          break;
        }
        case LDMIA: {
          const n = (op >> 8) & 7;
          let bits = op & 0xff;
          let a = r[n];
          for (let i = 0; bits; i++, bits >>= 1) {
            if (bits & 1) {
              r[i] = this.read32(a);
              a += 4;
              cycles++;
            }
          }
          if (!(op & (1 << n))) r[n] = a;
          break;
        }
        case STMIA: {
          const n = (op >> 8) & 7;
          let bits = op & 0xff;
          let a = r[n];
          for (let i = 0; bits; i++, bits >>= 1) {
            if (bits & 1) {
              this.write32(a, r[i]);
              a += 4;
              cycles++;
            }
          }
          r[n] = a;
          break;
        }
        case B_COND:
          if (holds(c, (op >> 8) & 15)) {
            r[15] = pc + 4 + ((op << 24) >> 23);
            cycles = 2;
          }
          break;
        case B:
          r[15] = pc + 4 + ((op << 21) >> 20);
          cycles = 2;
          break;
        case WIDE: cycles = this.wide(pc, op); break;
        case CPSID: c.PM = true; break;
        case CPSIE:
          c.PM = false;
          c.interruptsUpdated = true;
          break;
        case NOP: break;
        case SEV: c.eventRegistered = true; break;
        case WFE:
          cycles = 2;
          if (c.eventRegistered) c.eventRegistered = false;
          else c.waiting = true;
          break;
        case WFI:
          cycles = 2;
          c.sleepsUntilInterrupt = true;
          if (!(c.PM && c.pendingInterrupts & c.enabledInterrupts)) c.waiting = true;
          break;
        case SVC:
          c.pendingSVCall = true;
          c.interruptsUpdated = true;
          break;
        default:
          // BKPT without a debugger, UDF and what the core does not have.
          this.hardFault(`instruction ${op.toString(16)}`);
      }
      chip.now += cycles;
      if (c.waiting) break;
    }
    this.instructions += count;
  }

  wide(pc, op) {
    const { core: c, registers: r } = this;
    // Its second half may stand in the next line.
    if (pc >>> 24 === 0x10 && (pc + 2) >>> this.cache.shift !== this.cache.latest) {
      this.chip.now += this.cache.fetch(pc + 2);
    }
    const second =
      pc >>> 24 === 0x10
        ? this.flash16[((pc + 2) & 0xffffff) >> 1]
        : this.sram16[((pc + 2) & 0xfffff) >> 1];
    r[15] = pc + 4;
    if (op >> 11 === 0b11110 && (second & 0xd000) === 0xd000) {
      const s = (op >> 10) & 1;
      const i1 = 1 - (s ^ ((second >> 13) & 1));
      const i2 = 1 - (s ^ ((second >> 11) & 1));
      const offset =
        (s ? 0xff000000 : 0) |
        (i1 << 23) |
        (i2 << 22) |
        ((op & 0x3ff) << 12) |
        ((second & 0x7ff) << 1);
      r[14] = (pc + 4) | 1;
      r[15] = pc + 4 + offset;
      return 3;
    }
    if (op === 0xf3bf && (second & 0xff00) === 0x8f00) return 3; // DSB, DMB, ISB
    if (op === 0xf3ef && second >> 12 === 8) {
      r[(second >> 8) & 15] = c.readSpecialRegister(second & 0xff);
      return 3;
    }
    if (op >> 4 === 0xf38 && second >> 8 === 0x88) {
      c.writeSpecialRegister(second & 0xff, r[op & 15] >>> 0);
      return 3;
    }
    this.hardFault(`instruction ${op.toString(16)} ${second.toString(16)}`);
    return 3;
  }
}

/** Where the bus has nobody to answer: between flash and SRAM, and behind SRAM. */
function isNowhere(a) {
  return a >>> 28 === 2 || (a >>> 28 === 1 && a >= 0x1a000000);
}

function logic(c, v) {
  c.N = v < 0;
  c.Z = v === 0;
}

function add(c, a, b) {
  const v = (a + b) | 0;
  c.N = v < 0;
  c.Z = v === 0;
  c.C = v >>> 0 < a >>> 0;
  c.V = ((a ^ v) & (b ^ v)) < 0;
  return v;
}

function subtract(c, a, b) {
  const v = (a - b) | 0;
  c.N = v < 0;
  c.Z = v === 0;
  c.C = a >>> 0 >= b >>> 0;
  c.V = ((a ^ b) & (a ^ v)) < 0;
  return v;
}

function addCarry(c, a, b, carry) {
  const v = (a + b + carry) | 0;
  c.N = v < 0;
  c.Z = v === 0;
  c.C = (a >>> 0) + (b >>> 0) + carry > 0xffffffff;
  c.V = ((a ^ v) & (b ^ v)) < 0;
  return v;
}

function holds(c, cond) {
  switch (cond) {
    case 0: return c.Z;
    case 1: return !c.Z;
    case 2: return c.C;
    case 3: return !c.C;
    case 4: return c.N;
    case 5: return !c.N;
    case 6: return c.V;
    case 7: return !c.V;
    case 8: return c.C && !c.Z;
    case 9: return !c.C || c.Z;
    case 10: return c.N === c.V;
    case 11: return c.N !== c.V;
    case 12: return !c.Z && c.N === c.V;
    default: return c.Z || c.N !== c.V;
  }
}

function ones(bits) {
  let count = 0;
  for (; bits; bits &= bits - 1) count++;
  return count;
}

/** Beyond the first cycle: SIO answers at once, the APB and AHB-lite bridges take longer. */
function loadCycles(address) {
  const page = address >>> 28;
  return page === 13 ? 0 : page === 4 ? 3 : 1;
}

function storeCycles(address) {
  const page = address >>> 28;
  return page === 13 ? 0 : page === 4 ? 4 : 1;
}

function patchExceptions(taker, core, ppb) {
  const enter = core.exceptionEntry;
  core.exceptionEntry = (number) => {
    // Without a stack no other handler is entered, and that of faults begins without what is saved, or not at all.
    if ((core.registers[13] - 32 - 0x20000000) >>> 0 >= SRAM_SIZE) {
      taker.note(`no memory for the stack: ${(core.registers[13] >>> 0).toString(16)}`);
      if (taker.stopsWithoutStack) {
        taker.lockUp();
        return;
      }
      number = HARD_FAULT;
    }
    enter.call(core, number);
    taker.penalty += ENTRY_CYCLES;
    // The vector is read like any constant.
    const vector = core.VTOR + 4 * number;
    if (vector >>> 24 === 0x10) taker.penalty += taker.cache.read(vector);
    if (number >= 16) {
      core.pended &= ~(1 << (number - 16));
      core.pendingInterrupts = core.lines | core.pended;
      const times = taker.interrupts[number - 16];
      const { cycle } = taker.chip;
      times[1] = cycle;
      times[2] = times[0] < 0 ? cycle : times[0];
      times[3]++;
      times[4] = Math.max(times[4], cycle - times[2]);
      times[0] = -1;
    }
  };
  const leave = core.exceptionReturn;
  core.exceptionReturn = (value) => {
    const irq = core.IPSR - 16;
    if (irq >= 0) {
      const times = taker.interrupts[irq];
      const { cycle } = taker.chip;
      times[5] = Math.max(times[5], cycle - times[1]);
      times[6] = Math.max(times[6], cycle - times[2]);
      // A request that is there still waits from now on; one that came meanwhile, since it came.
      if (core.lines & (1 << irq) && times[0] < 0) times[0] = cycle;
    }
    leave.call(core, value);
    taker.penalty += RETURN_CYCLES;
  };
  core.setInterrupt = (irq, value) => {
    const bit = 1 << irq;
    if (!value) {
      core.lines &= ~bit;
      core.pendingInterrupts = core.lines | core.pended;
    } else if (!(core.lines & bit)) {
      core.lines |= bit;
      taker.interrupts[irq][0] = taker.chip.cycle;
      core.pendingInterrupts = core.lines | core.pended;
      core.interruptsUpdated = true;
      wake(core);
    }
  };
  core.checkForInterrupts = () => {
    core.interruptsUpdated = false;
    if (core.pendingNMI) {
      core.pendingNMI = false;
      core.exceptionEntry(2);
      return true;
    }
    const running = Math.min(core.exceptionPriority(core.IPSR), core.PM ? 0 : 4);
    const ready = core.pendingInterrupts & core.enabledInterrupts;
    for (let priority = 0; priority < running; priority++) {
      if (core.pendingSVCall && priority === core.svCallPriority) {
        core.pendingSVCall = false;
        core.exceptionEntry(11);
        return true;
      }
      if (core.pendingPendSV && priority === core.pendSVPriority) {
        core.pendingPendSV = false;
        core.exceptionEntry(14);
        return true;
      }
      if (core.pendingSystick && priority === core.systickPriority) {
        core.pendingSystick = false;
        core.exceptionEntry(15);
        return true;
      }
      const level = ready & core.interruptPriorities[priority];
      if (level) {
        core.exceptionEntry(16 + 31 - Math.clz32(level & -level));
        core.interruptsUpdated = true;
        return true;
      }
    }
    return false;
  };
  const write = ppb.writeUint32;
  ppb.writeUint32 = (offset, value) => {
    if (offset === 0x200) {
      core.pended |= value;
      core.pendingInterrupts = core.lines | core.pended;
      core.interruptsUpdated = true;
    } else if (offset === 0x280) {
      core.pended &= ~value;
      core.pendingInterrupts = core.lines | core.pended;
    } else if (offset === 0xd0c) {
      // AIRCR: SYSRESETREQ with its key.
      if (value >>> 16 === 0x05fa && value & 4) {
        taker.chip.resetRequested = 'software';
        taker.chip.limit = 0;
      }
    } else write.call(ppb, offset, value);
  };
  const read = ppb.readUint32;
  ppb.readUint32 = (offset) => (offset === 0xd0c ? 0xfa050000 : read.call(ppb, offset));
}

/** An interrupt that came while the core slept. */
function wake(core) {
  if (!core.waiting) return;
  if (core.checkForInterrupts()) core.waiting = false;
  else if (core.sleepsUntilInterrupt && core.pendingInterrupts & core.enabledInterrupts) {
    core.waiting = false;
  }
  if (!core.waiting) core.sleepsUntilInterrupt = false;
}
