// Turns of a state machine's loop that change nothing, left out.
//
// A machine that samples its inputs does so for ever, and nearly always sees what it saw before.
// Two turns of its loop are run as ever. If they went the same way, and left nothing else behind
// than the same words pushed to memory and registers that count down, so do all that follow until
// a pin changes, a counter comes near zero, or the channel that takes the words is full. Those
// turns are done at once: the registers and the ring in memory are what they would have been.
// What was learned about a loop serves again whenever the machine comes by in the same state.
//
// What a turn may do is read off its instructions: no waiting, no output, no flag, nothing from
// the queue; and what counts may be copied and compared with zero, but neither pushed nor changed
// in another way, nor may it say where the program goes on.

import { FAR, SYNC_CYCLES } from './pins.js';

/** Less than this is quicker done than looked at. */
const LEAST_CYCLES = 128;
/** A longer turn is none. */
const LONGEST_TURN = 40;
/** How often a machine that could not is not tried again. */
const PATIENCE = 16;
/** A counter this near to zero is left to count by itself. */
const NEAR_ZERO = 64;
const AUTOPULL = 1 << 17;
const X = 1, Y = 2, ISR = 4, OSR = 8;

/** A turn as it always is: where it begins, in which state, how long it takes, what it leaves. */
class Loop {
  constructor(machine, program, level, before, after, path, words) {
    this.program = program;
    this.execCtrl = machine.execCtrl;
    this.pinCtrl = machine.pinCtrl;
    this.level = level;
    this.pc = machine.pc;
    this.length = path.length;
    this.words = words;
    this.period = after.t - before.t;
    this.state = after;
    this.fallX = (before.x - after.x) | 0;
    this.fallY = (before.y - after.y) | 0;
    this.fallIsr = (before.isr - after.isr) | 0;
    this.fallOsr = (before.osr - after.osr) | 0;
    const counting =
      (this.fallX && X) | (this.fallY && Y) | (this.fallIsr && ISR) | (this.fallOsr && OSR);
    /** What falls does so at one pace: then what stands in one says what stands in the others. */
    this.pace = this.fallX || this.fallY || this.fallIsr || this.fallOsr;
    this.isEven = [this.fallX, this.fallY, this.fallIsr, this.fallOsr].every(
      (fall) => fall === 0 || fall === this.pace,
    );
    this.tested = this.isEven ? allows(machine, path, counting) : null;
  }

  get isOne() {
    return this.tested !== null && !(this.tested !== 0 && (this.pace < 0 || this.pace > NEAR_ZERO));
  }

  /** Whether a machine whose program and pins are the loop's stands at its beginning. */
  begins(machine) {
    const { state } = this;
    // How far a counter has gone on since; the same for all.
    const gone = this.fallX
      ? state.x - machine.x
      : this.fallY
        ? state.y - machine.y
        : this.fallIsr
          ? state.isr - machine.isr
          : state.osr - machine.osr;
    return (
      ((state.x - (this.fallX && gone)) | 0) === machine.x &&
      ((state.y - (this.fallY && gone)) | 0) === machine.y &&
      ((state.isr - (this.fallIsr && gone)) | 0) === machine.isr &&
      ((state.osr - (this.fallOsr && gone)) | 0) === machine.osr &&
      state.inCount === machine.inCount &&
      state.outCount === machine.outCount &&
      state.irqWait === machine.irqWait
    );
  }

  /** Goes round as often as it can up to a cycle. */
  go(machine, steady, peek) {
    let turns = Math.floor((steady - machine.t) / this.period);
    if (this.tested & X && this.fallX) turns = Math.min(turns, this.untilZero(machine.x));
    if (this.tested & Y && this.fallY) turns = Math.min(turns, this.untilZero(machine.y));
    if (this.words.length > 0) {
      // Trying it out, the machine stops where a push tells.
      if (peek ? machine.tellsPush : !machine.isFree) return;
      if (!peek) turns = Math.min(turns, Math.floor((machine.channel.transCount - 1) / this.words.length));
    }
    if (turns <= 0) return;
    if (this.words.length > 0 && !peek) machine.fill(this.words, turns);
    machine.x = (machine.x - Math.imul(turns, this.fallX)) | 0;
    machine.y = (machine.y - Math.imul(turns, this.fallY)) | 0;
    machine.isr = (machine.isr - Math.imul(turns, this.fallIsr)) | 0;
    machine.osr = (machine.osr - Math.imul(turns, this.fallOsr)) | 0;
    machine.t += turns * this.period;
  }

  untilZero(counter) {
    return Math.floor(((counter >>> 0) - 2 * NEAR_ZERO) / this.pace);
  }
}

/** Brings a machine that goes round on the spot forward, at most to a cycle. */
export function leap(machine, program, until, peek) {
  if (until - machine.t < LEAST_CYCLES) return;
  // Pins that are not synchronised are seen when they change; side sets are outputs.
  if (machine.pio.inputSyncBypass !== 0 || machine.pinCtrl >>> 29 || machine.shiftCtrl & AUTOPULL) return;
  const { at, levels, enabled, inverted } = machine.pins;
  while (at[machine.k + 1] <= machine.t - SYNC_CYCLES) machine.k++;
  const steady = Math.min(until, at[machine.k + 1] + SYNC_CYCLES);
  if (steady - machine.t < LEAST_CYCLES) return;
  const level = (levels[machine.k] & enabled) ^ inverted;

  const { loop } = machine;
  if (
    loop !== null && loop.program === program && loop.level === level &&
    loop.execCtrl === machine.execCtrl && loop.pinCtrl === machine.pinCtrl
  ) {
    for (let step = 0; step < loop.length && machine.pc !== loop.pc; step++) {
      program(machine, machine.t + 1, peek);
      if (machine.stopped || machine.t >= steady) return;
    }
    if (machine.pc === loop.pc && loop.begins(machine)) {
      loop.go(machine, steady, peek);
      return;
    }
  }
  if (machine.leapless > 0) {
    machine.leapless--;
    return;
  }
  machine.loop = learn(machine, program, level, steady, peek);
  if (machine.loop === null) machine.leapless = PATIENCE;
  else machine.loop.go(machine, steady, peek);
}

/** Two turns as ever, and what they have in common, if that will go on. */
function learn(machine, program, level, steady, peek) {
  const before = registers(machine);
  const first = turn(machine, program, steady, peek);
  if (first === null) return null;
  const between = registers(machine);
  const second = turn(machine, program, steady, peek);
  if (second === null || !isSame(first.path, second.path) || !isSame(first.words, second.words)) return null;
  const after = registers(machine);
  if (after.t - between.t !== between.t - before.t) return null;
  for (const name of ['x', 'y', 'isr', 'osr']) {
    if (((after[name] - between[name]) | 0) !== ((between[name] - before[name]) | 0)) return null;
  }
  for (const name of ['inCount', 'outCount', 'irqWait']) if (before[name] !== after[name]) return null;
  const loop = new Loop(machine, program, level, between, after, first.path, first.words);
  return loop.isOne ? loop : null;
}

function registers({ x, y, isr, osr, inCount, outCount, irqWait, t }) {
  return { x, y, isr, osr, inCount, outCount, irqWait, t };
}

/** Once round: the way that it went, and what it pushed; or nothing, if it is no loop. */
function turn(machine, program, steady, peek) {
  const start = machine.pc;
  const path = [];
  const words = [];
  machine.pushed = words;
  do {
    path.push(machine.pc);
    program(machine, machine.t + 1, peek);
    if (machine.stopped || machine.t >= steady || machine.t === FAR) {
      machine.pushed = null;
      return null;
    }
  } while (machine.pc !== start && path.length < LONGEST_TURN);
  machine.pushed = null;
  return machine.pc === start ? { path, words } : null;
}

function isSame(a, b) {
  return a.length === b.length && a.every((value, index) => value === b[index]);
}

/**
 * Whether a turn does nothing that the next, with its counters further down, would do
 * otherwise. Returns which counters are compared with zero on the way, or null.
 */
function allows(machine, path, counting) {
  const { instructions } = machine.pio;
  let counted = counting;
  let tested = 0;
  const mark = (bit, isCounted) => {
    counted = isCounted ? counted | bit : counted & ~bit;
  };
  for (const pc of path) {
    const op = instructions[pc];
    const arg = op & 0xff;
    const which = arg >> 5;
    switch (op >>> 13) {
      case 0:
        if (which === 1 || which === 3 || which === 5) {
          const read = which === 1 ? X : which === 3 ? Y : X | Y;
          if (counted & read) return null;
        } else if (which === 2) tested |= X;
        else if (which === 4) tested |= Y;
        break;
      case 2: {
        const source = [0, X, Y, 0, 0, 0, ISR, OSR][which];
        // Shifted, it falls at another pace.
        if (counted & (source | ISR)) return null;
        break;
      }
      case 3:
        // It shifts what it takes out of; and pins, directions and programs are outputs.
        if (counted & OSR || which === 0 || which === 4 || which === 7) return null;
        mark([0, X, Y, 0, 0, 0, ISR, 0][which], false);
        break;
      case 4:
        if (arg & 0xc0 || counted & ISR) return null;
        break;
      case 5: {
        const from = [0, X, Y, 0, 0, 0, ISR, OSR][arg & 7];
        const isCounted = (counted & from) !== 0;
        if ((arg & 7) === 5 || which === 0 || which === 4) return null;
        if (isCounted && (arg & 0x18 || which === 5)) return null;
        mark([0, X, Y, 0, 0, 0, ISR, OSR][which], isCounted);
        break;
      }
      case 7:
        if (which !== 1 && which !== 2) return null;
        mark(which === 1 ? X : Y, false);
        break;
      default:
        return null;
    }
  }
  return counted === counting ? tested : null;
}
