// Emulated time for the peripherals of rp2040js: the core's cycles, at 8 ns each.
//
// The same interface as rp2040js's SimulationClock, which is advanced in nanoseconds by whoever
// runs the core; here the chip asks when the next alarm is due.

export const NANOS_PER_CYCLE = 8;

class Alarm {
  constructor(clock, callback) {
    this.clock = clock;
    this.callback = callback;
    this.cycle = Infinity;
    this.scheduled = false;
    this.next = null;
  }

  schedule(nanos) {
    this.at(this.clock.chip.cycle + Math.ceil(nanos / NANOS_PER_CYCLE));
  }

  /** Calls back at this cycle, at the earliest after what happens now. */
  at(cycle) {
    this.cancel();
    this.cycle = cycle;
    this.scheduled = true;
    this.clock.insert(this);
  }

  cancel() {
    if (this.scheduled) {
      this.scheduled = false;
      this.clock.remove(this);
    }
  }
}

export class Clock {
  constructor(chip) {
    this.chip = chip;
    this.first = null;
    this.frequency = 1e9 / NANOS_PER_CYCLE;
  }

  get nanos() {
    return this.chip.cycle * NANOS_PER_CYCLE;
  }

  get micros() {
    return this.nanos / 1000;
  }

  createAlarm(callback) {
    return new Alarm(this, callback);
  }

  insert(alarm) {
    let before = null;
    let after = this.first;
    while (after !== null && after.cycle <= alarm.cycle) {
      before = after;
      after = after.next;
    }
    alarm.next = after;
    if (before === null) {
      this.first = alarm;
      this.chip.limit = 0;
    } else before.next = alarm;
  }

  remove(alarm) {
    if (this.first === alarm) this.first = alarm.next;
    else {
      let before = this.first;
      while (before !== null && before.next !== alarm) before = before.next;
      if (before !== null) before.next = alarm.next;
    }
    alarm.next = null;
  }

  /** When somebody wants to be called next. */
  get due() {
    return this.first === null ? Infinity : this.first.cycle;
  }

  /** Calls who is due at this cycle or was before. */
  fire(cycle) {
    while (this.first !== null && this.first.cycle <= cycle) {
      const alarm = this.first;
      this.first = alarm.next;
      alarm.next = null;
      alarm.scheduled = false;
      alarm.callback();
    }
  }
}
