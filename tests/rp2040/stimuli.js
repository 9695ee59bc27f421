// What the machine tool does to the board's inputs, generated here: the encoders of four axes,
// and pulses on the other inputs, with the truth about both.
//
// All times are cycles of the board's clock (8 ns), counted from when the board first had power.
// An edge at a cycle is there at that cycle. A position includes the edges up to and at it.

import { MARGIN, WINDOW } from './pins.js';

/** A and B of a quadrature signal, counted up: A leads. */
const GRAY = [0b00, 0b01, 0b11, 0b10];

/**
 * Cycles from an edge to the glitch that follows it: several samples, for nobody can tell a glitch
 * at an edge from a transition that is none.
 */
const GLITCH_AFTER = 40;

/** A small generator of repeatable random numbers (Marsaglia 2003, xorshift32), in [0, 1). */
class Random {
  constructor(seed) {
    this.state = seed | 0 || 1;
  }
  next() {
    let x = this.state;
    x ^= x << 13;
    x ^= x >>> 17;
    x ^= x << 5;
    this.state = x;
    return (x >>> 0) / 2 ** 32;
  }
}

/**
 * One axis: A on `pin`, B on `pin + 1`. A profile is a list of segments, gone through `repeat`
 * times; each segment is { edges, from, to = from, up = true } with cycles per edge at its begin
 * and end (constant acceleration between), or { rest: cycles }. Of every `skipEvery` edges one is
 * skipped: A and B change together, a transition that no encoder makes. `bounce` is how often
 * (0..1) an edge comes as five with `bounceCycles` between, `glitch` how often one is followed by
 * a pulse of `glitchCycles` on the other signal.
 */
class Axis {
  constructor(pin) {
    this.pin = pin;
    this.position = 0;
    this.illegal = 0;
    this.edges = 0;
    this.phase = 0;
    this.lastAt = -1e15;
    this.next = Infinity;
    this.plan = null;
    /** Extra changes of one signal, before the next edge: [cycle, bits]. */
    this.extra = [];
    this.bits = 0;
  }

  start(profile, at) {
    const { segments, repeat = 1, skipEvery = 0, bounce = 0, bounceCycles = 2 } = profile;
    const { glitch = 0, glitchCycles = 3, seed = 1 } = profile;
    this.plan = { segments, repeat, skipEvery, bounce, bounceCycles, glitch, glitchCycles };
    this.random = new Random(seed * 7919 + this.pin);
    this.segment = 0;
    this.done = 0;
    this.clock = at;
    this.advance();
  }

  /** The cycle of the next edge, in exact time. */
  advance() {
    const { plan } = this;
    for (;;) {
      const segment = plan.segments[this.segment];
      if (segment.rest !== undefined && this.done === 0) {
        this.clock += segment.rest;
        this.done = 1;
      } else if (segment.rest === undefined && this.done < segment.edges) {
        const { from, to = from, edges } = segment;
        let interval = from;
        if (to !== from) {
          // Constant acceleration: the square of the rate is linear in the way.
          const share = (this.done + 0.5) / edges;
          interval = 1 / Math.sqrt((1 - share) / (from * from) + share / (to * to));
        }
        this.done++;
        this.clock += interval;
        this.next = Math.floor(this.clock);
        return;
      }
      if (segment.rest !== undefined || this.done >= segment.edges) {
        this.done = 0;
        if (++this.segment === plan.segments.length) {
          this.segment = 0;
          if (--plan.repeat <= 0) {
            this.plan = null;
            this.next = Infinity;
            return;
          }
        }
      }
    }
  }

  get due() {
    return this.extra.length > 0 ? Math.min(this.extra[0][0], this.next) : this.next;
  }

  /** The levels of A and B from `due` on. */
  step() {
    const at = this.due;
    if (this.extra.length > 0 && this.extra[0][0] === at && at < this.next) {
      this.bits = this.extra.shift()[1];
      return this.bits;
    }
    this.extra.length = 0;
    const { plan } = this;
    const up = plan.segments[this.segment].up !== false;
    const by = up ? 1 : -1;
    const was = GRAY[this.phase];
    let steps = by;
    if (plan.skipEvery && this.edges % plan.skipEvery === plan.skipEvery - 1) {
      steps = 2 * by;
      this.illegal++;
    }
    this.phase = (this.phase + steps) & 3;
    this.position += steps;
    this.edges++;
    this.lastAt = at;
    this.bits = GRAY[this.phase];
    this.advance();
    if (plan.bounce && steps === by && this.random.next() < plan.bounce) {
      for (let i = 1; i <= 4; i++) this.add(at + i * plan.bounceCycles, i % 2 ? was : this.bits);
    } else if (plan.glitch && this.random.next() < plan.glitch) {
      const other = this.bits ^ was ^ 3;
      this.add(at + GLITCH_AFTER, this.bits ^ other);
      this.add(at + GLITCH_AFTER + plan.glitchCycles, this.bits);
    }
    return this.bits;
  }

  add(at, bits) {
    // What does not fit before the next edge does not come: a whole pulse or none.
    this.extra.push([at, bits]);
    if (at >= this.next) this.extra.length = 0;
  }
}

/**
 * Pulses on a pin, `width` cycles long: at the cycles `at`, or `count` of them every `period`
 * cycles from `start`, each moved by up to `jitter` cycles. `widths` are those of the pulses `at`,
 * where they differ. `active` is the level of a pulse. With `record`, the truth at each leading
 * edge is kept, with `both` at the other edges, too.
 */
class Pulses {
  constructor(spec, start) {
    const { pin, at = null, period = 0, count = 0, jitter = 0, width = 100, widths = null } = spec;
    const { active = 1, record = false, both = false, seed = 1 } = spec;
    Object.assign(this, { pin, at, period, count, jitter, width, widths, active, record, both, start });
    this.random = new Random(seed * 104729 + pin);
    this.index = 0;
    this.isOn = false;
    this.plan();
  }

  plan() {
    if (this.at !== null) {
      this.due = this.index < this.at.length ? this.start + this.at[this.index] : Infinity;
    } else if (this.index < this.count) {
      const nominal = this.start + this.index * this.period;
      this.due = Math.floor(nominal + this.random.next() * this.jitter);
    } else this.due = Infinity;
  }

  step() {
    this.isOn = !this.isOn;
    if (this.isOn) this.due += this.widths?.[this.index] ?? this.width;
    else {
      this.index++;
      this.plan();
    }
    return this.isOn ? this.active : 1 - this.active;
  }
}

export class Stimuli {
  constructor(axisPins) {
    this.axes = axisPins.map((pin) => new Axis(pin));
    this.pulses = [];
    this.levels = 0;
    this.horizon = 0;
    /** Per recorded edge: pin, cycle, then per axis: position, cycles since its last edge and
     * until its next (-1: none). */
    this.truth = [];
    this.changes = [];
  }

  /** Levels that stay: bits of the pins, from the next window on. */
  set(pin, level) {
    this.changes.push([pin, level]);
  }

  /** Starts what a profile says, `after` cycles after what is settled already; says when. */
  startAxis(axis, profile, after = 0) {
    const start = this.horizon + after;
    this.axes[axis].start(profile, start);
    return start;
  }

  startPulses(spec, after = 0) {
    const start = this.horizon + after;
    this.pulses.push(new Pulses(spec, start));
    return start;
  }

  /** Ends every motion and every train of pulses. */
  stop() {
    for (const axis of this.axes) {
      axis.plan = null;
      axis.next = Infinity;
      axis.extra.length = 0;
      axis.bits = GRAY[axis.phase];
    }
    for (const train of this.pulses) if (train.isOn) this.set(train.pin, 1 - train.active);
    this.pulses.length = 0;
  }

  /** Notes every change in the window that begins at `base`, and a bit further. */
  fill(base, pins) {
    const end = base + WINDOW + MARGIN;
    let { levels } = this;
    for (const [pin, level] of this.changes) levels = put(levels, pin, level);
    this.changes.length = 0;
    pins.note(this.horizon - base, levels);
    const { axes, pulses } = this;
    const dues = axes.map((axis) => axis.due);
    for (;;) {
      let at = end;
      let who = -1;
      for (let i = 0; i < dues.length; i++) {
        if (dues[i] < at) {
          at = dues[i];
          who = i;
        }
      }
      let train = null;
      for (let i = 0; i < pulses.length; i++) {
        if (pulses[i].due < at) {
          at = pulses[i].due;
          train = pulses[i];
        }
      }
      if (train !== null) {
        const recorded = train.isOn ? train.both : true;
        levels = put(levels, train.pin, train.step());
        if (recorded && train.record) this.record(train.pin, at);
      } else if (who >= 0) {
        const axis = axes[who];
        levels = (levels & ~(3 << axis.pin)) | (axis.step() << axis.pin);
        dues[who] = axis.due;
      } else break;
      pins.note(at - base, levels);
    }
    this.pulses = pulses.filter((train) => train.due !== Infinity);
    this.levels = levels;
    this.horizon = end;
  }

  record(pin, at) {
    const { truth } = this;
    truth.push(pin, at);
    for (const axis of this.axes) {
      const next = axis.next === Infinity ? -1 : axis.next - at;
      truth.push(axis.position, Math.min(at - axis.lastAt, 1e9), next);
    }
  }
}

function put(levels, pin, level) {
  return level ? levels | (1 << pin) : levels & ~(1 << pin);
}
