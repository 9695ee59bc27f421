// The levels that the world puts on the pins, and when they change.
//
// The chip runs in windows of WINDOW cycles. Before one begins, the stimuli write every change
// of a pin in it here, as (cycle in the window, levels of all pins): whoever samples a pin at a
// cycle looks it up, however far the others are. Changes of pins that can interrupt the core are
// listed apart, to be delivered at their cycle.
//
// The pins' synchronisers delay what the chip sees by two cycles (RP2040 datasheet 3.5.6.3 and
// 2.19.6: SYNC_CYCLES); rp2040js has none. What a pin's pad and GPIO_CTRL do to an input (IE,
// INOVER) is applied on reading. A pin that the chip drives reads as what it drives (2.19.4),
// but makes no interrupts.

export const WINDOW = 4096;
/** Changes are known so far beyond the window: an instruction that begins in it ends there. */
export const MARGIN = 1024;
export const SYNC_CYCLES = 2;
export const FAR = 0x3fffffff;
const ROOM = 1 << 16;
/** Axis signals, which are fast; the core can have interrupts of the others at any time. */
const FAST_PINS = 0x0000ff00;
const EDGE_HIGH = 8, EDGE_LOW = 4, LEVEL_HIGH = 2, LEVEL_LOW = 1;
/** RP2040 datasheet 2.19.6.3: pads come up with their input enabled; rp2040js says not. */
const PAD_RESET = 0x56;

export class Pins {
  constructor(chip, levels) {
    this.chip = chip;
    this.at = new Int32Array(ROOM);
    this.levels = new Int32Array(ROOM);
    this.events = [];
    this.nextEvent = 0;
    /** Inputs that are enabled, and those whose sense is turned round. */
    this.enabled = 0;
    this.inverted = 0;
    /** Pins that the chip drives, and how. */
    this.driven = 0;
    this.outputs = 0;
    this.cursor = 0;
    this.clear(levels);
    this.patch();
  }

  clear(levels) {
    this.at[0] = -FAR;
    this.levels[0] = levels;
    this.at[1] = FAR;
    this.count = 1;
    this.events.length = 0;
    this.nextEvent = 0;
  }

  /** What the world has on the pins after the last change that is known. */
  get last() {
    return this.levels[this.count - 1];
  }

  /** The window is over: the last changes that a synchroniser still hides are kept. */
  turn(length) {
    const { at, levels } = this;
    let keep = this.count - 1;
    while (keep > 0 && at[keep] > length - SYNC_CYCLES - 2) keep--;
    let count = 0;
    for (let i = keep; i < this.count; i++, count++) {
      at[count] = at[i] - length;
      levels[count] = levels[i];
    }
    at[0] = -FAR;
    this.count = count;
    at[count] = FAR;
    this.cursor = 0;
    this.events = this.events.slice(this.nextEvent);
    for (const event of this.events) event.cycle -= length;
    this.nextEvent = 0;
    this.interrupting = 0;
    for (const pin of this.chip.rp.gpio) {
      if (pin.irqEnableMask) this.interrupting |= 1 << pin.index;
    }
    this.interrupting |= ~FAST_PINS;
  }

  /** A change at a cycle of the window that follows, not before the one noted last. */
  note(cycle, world) {
    const { at } = this;
    const levels = (world & ~this.driven) | (this.outputs & this.driven);
    const changed = this.levels[this.count - 1] ^ levels;
    if (changed === 0) return;
    if (at[this.count - 1] === cycle) this.levels[this.count - 1] = levels;
    else {
      if (this.count + 2 > ROOM) throw new Error('more than 65000 pin changes in 4096 cycles');
      at[this.count] = cycle;
      this.levels[this.count] = levels;
      this.count++;
      at[this.count] = FAR;
    }
    if (changed & this.interrupting) this.events.push({ cycle: cycle + SYNC_CYCLES, changed, levels });
  }

  /** The chip drives a pin from a cycle on, or does not any more. */
  output(index, isDriven, level, cycle) {
    const bit = 1 << index;
    if (isDriven) this.driven |= bit;
    else this.driven &= ~bit;
    this.outputs = level ? this.outputs | bit : this.outputs & ~bit;
    this.chip.disturb();
    if (!isDriven) return;
    const { at, levels } = this;
    let i = this.count - 1;
    while (i > 0 && at[i] > cycle) i--;
    if (at[i] !== cycle) {
      // Who has looked further keeps an earlier place in the list, and goes on from there.
      at.copyWithin(i + 2, i + 1, this.count + 1);
      levels.copyWithin(i + 2, i + 1, this.count);
      i++;
      at[i] = cycle;
      levels[i] = levels[i - 1];
      this.count++;
    }
    for (; i < this.count; i++) levels[i] = level ? levels[i] | bit : levels[i] & ~bit;
  }

  /** What the chip reads at a cycle of this window. */
  read(cycle) {
    const { at, levels } = this;
    let i = this.cursor;
    if (at[i] > cycle) i = 0;
    while (at[i + 1] <= cycle) i++;
    this.cursor = i;
    return (levels[i] & this.enabled) ^ this.inverted;
  }

  get dueEvent() {
    return this.nextEvent < this.events.length ? this.events[this.nextEvent].cycle : FAR;
  }

  /** Delivers what has changed up to this cycle to the pins' interrupts. */
  fire(cycle) {
    while (this.nextEvent < this.events.length && this.events[this.nextEvent].cycle <= cycle) {
      const { changed, levels } = this.events[this.nextEvent++];
      for (let rest = changed; rest; rest &= rest - 1) {
        const index = 31 - Math.clz32(rest & -rest);
        if (index < 30) this.drive(this.chip.rp.gpio[index], ((levels >>> index) & 1) === 1);
      }
    }
  }

  /** An input changes, as its interrupts see it (datasheet 2.19.3). */
  drive(pin, level) {
    const was = pin.inputValue;
    pin.rawInputValue = level;
    this.interrupt(pin, was);
  }

  /** rp2040js notes an edge at every write of a level or of a pad; only a change is one. */
  interrupt(pin, was) {
    const is = pin.inputValue;
    if (is === was) return;
    pin.irqStatus = (pin.irqStatus & (EDGE_HIGH | EDGE_LOW)) | (is ? EDGE_HIGH | LEVEL_HIGH : EDGE_LOW | LEVEL_LOW);
    this.chip.rp.updateIOInterrupt();
  }

  refresh() {
    this.enabled = 0;
    this.inverted = 0;
    for (const pin of this.chip.rp.gpio) {
      const bit = 1 << pin.index;
      switch (pin.inputOverride) {
        case 0: if (pin.inputEnable) this.enabled |= bit; break;
        case 1: if (pin.inputEnable) this.enabled |= bit; this.inverted |= bit; break;
        case 3: this.inverted |= bit; break;
      }
    }
  }

  patch() {
    const { rp } = this.chip;
    for (const pin of rp.gpio) {
      pin.padValue = PAD_RESET;
      pin.rawInputValue = ((this.levels[0] >>> pin.index) & 1) === 1;
      pin.irqStatus = pin.rawInputValue ? LEVEL_HIGH : LEVEL_LOW;
      pin.refreshInput = () => {};
      pin.addListener(() => {
        const { now, stamp } = this.chip;
        this.output(pin.index, pin.outputEnable, pin.outputValue, stamp >= 0 ? Math.floor(stamp) : now);
      });
    }
    for (const page of [0x40014, 0x4001c]) {
      const peripheral = rp.peripherals[page];
      const write = peripheral.writeUint32;
      peripheral.writeUint32 = (offset, value) => {
        this.chip.synchronise();
        const pin = rp.gpio[page === 0x40014 ? offset >>> 3 : (offset - 4) >>> 2];
        const was = pin?.inputValue;
        write.call(peripheral, offset, value);
        if (pin) {
          this.interrupt(pin, was);
          this.refresh();
          this.chip.disturb();
        }
      };
    }
    Object.defineProperty(rp, 'gpioValues', {
      get: () => this.read(this.chip.now - SYNC_CYCLES) & 0x3fffffff,
    });
    this.refresh();
  }
}
