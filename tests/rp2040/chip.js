// One RP2040: rp2040js with its core, PIO, inputs and time replaced by ours, run cycle for cycle.
//
// Time goes in windows of WINDOW cycles (see pins.js); `now` is the cycle in the window, `base`
// the cycle at which it began. State machines are brought up to the present when somebody looks:
// at a register of PIO or DMA, at a pin, at memory that a channel fills. Those whose doings the
// core can notice by itself (an interrupt) are "live": before the core runs on, they are tried out
// to the cycle of the next such thing, and the core stops there. Nothing is seen before or after
// its cycle.

import { LogLevel, RP2040 } from 'rp2040js';
import { Clock } from './clock.js';
import { Core } from './core.js';
import * as pio from './pio.js';
import { FAR, Pins, WINDOW } from './pins.js';

const VECTORS = 0x10000100;
const FLASH = 0x10000000;
const FLASH_SIZE = 16 * 1024 * 1024;
const CHIP_RESET = 0x8;
const HAD_POR = 1 << 8;
const FIRST_REACH = 64;
/** What stands in every byte of the RAM after power-up: on silicon it is anything. */
const UNTOUCHED = 0xa5;

export class Chip {
  /**
   * A chip out of reset, with `segments` in its flash. `world` makes the changes of the pins:
   * `levels` and `fill(base, pins)`. `reason` is what the watchdog's registers say,
   * `scratch` what they keep, and `memory` what the reset left in RAM; after power-up all of it
   * is UNTOUCHED.
   */
  constructor(
    segments,
    world,
    { epoch = 0, reason = 0, powerOn = true, scratch = null, memory = null } = {},
  ) {
    this.world = world;
    /** The board's cycle at which this chip came out of reset. */
    this.epoch = epoch;
    this.base = 0;
    this.now = 0;
    this.limit = 0;
    this.live = [];
    /** How far live machines are tried out: further as long as nobody touches them. */
    this.reach = FIRST_REACH;
    /** Until this cycle they do nothing that the core could notice. */
    this.safe = 0;
    this.running = [];
    this.stamp = -1;
    this.resetRequested = null;
    this.slept = 0;
    this.watchLow = FAR;
    this.watchHigh = 0;
    /** Whether machines leave out turns that change nothing (leap.js); tests compare both. */
    this.leaps = true;
    /** Nobody but the core gets the bus. */
    this.areTransfersHeld = false;
    /** What is there of the boot ROM (rom.js). */
    this.rom = null;
    this.rp = new RP2040(new Clock(this));
    this.clock = this.rp.clock;
    this.rp.logger = new Quiet();
    for (const { address, bytes } of segments) {
      if (address < FLASH || address + bytes.length > FLASH + FLASH_SIZE) {
        throw new Error(`the image has a segment at ${address.toString(16)}, outside the flash`);
      }
      this.rp.flash.set(bytes, address - FLASH);
    }
    if (memory) this.rp.sram.set(memory);
    else this.rp.sram.fill(UNTOUCHED);
    this.pins = new Pins(this, world.levels);
    pio.install(this);
    this.core = new Core(this);
    const { core } = this.rp;
    core.VTOR = VECTORS;
    core.reset();
    const watchdog = this.rp.peripherals[0x40058];
    watchdog.reason = reason;
    if (scratch) watchdog.scratchData.set(scratch);
    watchdog.onWatchdogTrigger = () => {
      // It has run out: its alarm would be due again in this cycle, without end.
      watchdog.timer.enable = false;
      this.resetRequested = watchdog.reason === 1 ? 'watchdog timer' : 'watchdog';
      this.limit = 0;
    };
    const voltage = this.rp.peripherals[0x40064];
    voltage.readUint32 = (offset) => (offset === CHIP_RESET && powerOn ? HAD_POR : 0);
    patchTimer(this, this.rp.peripherals[0x40054]);
    this.pins.turn(0);
    world.fill(this.epoch, this.pins);
  }

  /** Cycles since the reset: the chip's own time. */
  get cycle() {
    return this.base + this.now;
  }

  get memory() {
    return this.rp.sram;
  }

  get scratch() {
    return this.rp.peripherals[0x40058].scratchData;
  }

  /** Runs to a cycle, or until a reset is asked for. */
  run(until) {
    const { core } = this.rp;
    while (this.cycle < until && this.resetRequested === null) {
      if (this.now >= WINDOW) this.turn();
      if (this.clock.due <= this.cycle) this.clock.fire(this.cycle);
      if (this.pins.dueEvent <= this.now) this.pins.fire(this.now);
      const limit = Math.min(WINDOW, until - this.base, this.pins.dueEvent, this.clock.due - this.base);
      this.limit = this.live.length > 0 ? this.tryOut(limit) : limit;
      if (core.waiting && core.interruptsUpdated && core.checkForInterrupts()) core.waiting = false;
      if (core.waiting) {
        this.slept += Math.max(0, this.limit - this.now);
        this.now = Math.max(this.limit, this.now);
      } else this.core.run();
      if (this.live.length > 0 && this.now >= this.safe) this.synchronise();
    }
    this.synchronise();
  }

  /** The cycle up to which the core can run before a machine does what it could notice. */
  tryOut(limit) {
    if (this.safe <= this.now) {
      let until = Math.min(WINDOW, this.now + this.reach);
      this.reach = Math.min(2 * this.reach, WINDOW);
      for (const machine of this.live) {
        if (machine.t >= until) continue;
        machine.save();
        machine.run(until, true);
        if (machine.stopped) until = machine.t + 1;
        machine.restore();
      }
      this.safe = until;
    }
    return Math.min(limit, this.safe);
  }

  /** Brings every machine up to the present: first those that change pins, since others see that some cycles later. */
  synchronise() {
    for (const machine of this.running) if (machine.t < this.now) machine.run(this.now, false);
  }

  /** Somebody has changed what machines will do. */
  disturb() {
    this.reach = FIRST_REACH;
    this.safe = 0;
    this.limit = 0;
  }

  /** The window ends: the next begins here. */
  turn() {
    this.synchronise();
    const length = this.now;
    for (const block of this.rp.pio) {
      for (const machine of block.machines) {
        machine.k = 0;
        if (machine.t !== FAR) machine.t -= length;
      }
    }
    this.pins.turn(length);
    this.base += length;
    this.safe = 0;
    this.now = 0;
    this.world.fill(this.epoch + this.base, this.pins);
  }

  /** Which machines run, and which of them beside the core: the others when somebody looks. */
  classify() {
    const enabled = this.machines.filter((machine) => machine.enabled);
    const drivers = enabled.filter((machine) => machine.drivesPins);
    this.running = drivers.concat(enabled.filter((machine) => !machine.drivesPins));
    this.live = this.running.filter((machine) => machine.isLive);
    this.disturb();
  }

  /** From now on no DMA channel gets a transfer, for so many cycles. */
  holdTransfers(cycles) {
    this.synchronise();
    this.areTransfersHeld = true;
    this.rp.uart[0].updateDMARx?.();
    const { machines } = this;
    this.clock.createAlarm(() => {
      this.synchronise();
      this.areTransfersHeld = false;
      for (const machine of machines) machine.updateDMARx();
      this.rp.uart[0].updateDMARx?.();
    }).at(this.cycle + cycles);
    this.disturb();
  }

  get machines() {
    return this.rp.pio.flatMap((block) => block.machines);
  }

  /** Memory that a channel fills: whoever reads it sees the present. */
  watch(low, high) {
    this.watchLow = Math.min(this.watchLow, low);
    this.watchHigh = Math.max(this.watchHigh, high);
  }
}

/** An alarm fires when the timer reaches its value (datasheet 4.6.3), not up to 1 us before. */
function patchTimer(chip, timer) {
  const write = timer.writeUint32;
  timer.writeUint32 = (offset, value) => {
    if (offset < 0x10 || offset > 0x1c) return write.call(timer, offset, value);
    const alarm = timer.alarms[(offset - 0x10) / 4];
    const micros = Math.floor(chip.clock.nanos / 1000);
    const wait = (value - micros) >>> 0;
    alarm.armed = true;
    alarm.targetMicros = value;
    alarm.clockAlarm.at(Math.ceil(((micros + (wait || 2 ** 32)) * 1000) / 8));
  };
}

/** rp2040js tells what it does not have at every access; only errors matter here. */
class Quiet {
  constructor() {
    this.currentLogLevel = LogLevel.Error;
  }
  debug() {}
  info() {}
  warn() {}
  error(component, message) {
    console.error(`[${component}] ${message}`);
  }
}
