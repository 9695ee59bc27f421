// One board: the chip, what is soldered to it, and what is plugged into it. It outlives resets
// and power cuts of the chip.

import { CacheControl } from './cache.js';
import { Chip } from './chip.js';
import { Nor, connect } from './nor.js';
import { FlashMemory, Noise, Rom, connectNoise } from './rom.js';
import { Stimuli } from './stimuli.js';
import { Control, Uart } from './uart.js';
import { UsbHost } from './usb.js';

const UART0 = 0x40034, UART0_IRQ = 20;
const XIP_CTRL = 0x14000, ROSC = 0x40060;
const NOR_SELECT = 5;
/** The journal's MISO, which the jumper pulls low while nobody is selected; else it is pulled up. */
export const JUMPER = 4;
/** The module's divider at the 5 V of the USB plug. */
const VBUS = 24;
const AXIS_PINS = [8, 10, 12, 14];
/** Laser enable, trigger out, LED, OK, NG, busy. */
export const OUTPUT_PINS = [21, 22, 25, 26, 27, 28];
const OUTPUTS_KEPT = 1 << 20;
const SECTOR = 4096;

export class Board {
  constructor(segments, uniqueId) {
    this.segments = segments;
    this.stimuli = new Stimuli(AXIS_PINS);
    this.stimuli.levels = 1 << JUMPER | 1 << VBUS;
    this.nor = new Nor(uniqueId);
    this.noise = new Noise(uniqueId.readInt32LE(0));
    /** The flash that the code runs from. */
    this.flash = new FlashMemory();
    this.flash.onCut = () => this.powerOff();
    this.control = new Control();
    this.usb = new UsbHost();
    /** Every change of an output: [pin, level, cycle]. */
    this.outputs = [];
    this.resets = [];
    this.chip = null;
    this.elapsed = 0;
    this.nor.onCut = (done) => this.powerOff(done);
    this.powerOn();
  }

  get isOn() {
    return this.chip !== null;
  }

  /** Cycles since the board first had power; they stand still while it has none. */
  get cycle() {
    return this.chip === null ? this.elapsed : this.chip.epoch + this.chip.cycle;
  }

  /** Puts the USB plug in, or pulls it. The module's divider shows the chip its 5 V. */
  plugUsb(isPlugged) {
    this.stimuli.set(VBUS, isPlugged ? 1 : 0);
    if (this.isOn) this.usb.plug(isPlugged);
    else this.usb.plugged = isPlugged;
  }

  powerOn() {
    if (this.chip === null) this.start({ powerOn: true });
  }

  start(options) {
    // The stimuli are settled up to their horizon: the chip begins there.
    const epoch = Math.max(this.cycle, this.stimuli.horizon);
    const chip = new Chip(this.segments, this.stimuli, { ...options, epoch });
    this.chip = chip;
    const uart = new Uart(chip, this.control, UART0_IRQ);
    chip.rp.uart[0] = uart;
    chip.rp.peripherals[UART0] = uart;
    chip.rp.peripherals[XIP_CTRL] = new CacheControl(chip);
    connectNoise(this.noise, chip.rp.peripherals[ROSC]);
    chip.rom = new Rom(chip, this.flash);
    this.control.uart = uart;
    this.usb.connect(chip);
    connect(this.nor, chip, NOR_SELECT);
    for (const index of OUTPUT_PINS) {
      const pin = chip.rp.gpio[index];
      let was = null;
      pin.addListener(() => {
        const is = pin.outputEnable ? (pin.outputValue ? 1 : 0) : null;
        if (is === was) return;
        was = is;
        if (is !== null) this.note(index, is, chip);
      });
    }
  }

  /** What the board has written into its flashes: rows of address and bytes (hex). */
  flashes() {
    const nor = [];
    for (let at = 0; at < this.nor.data.length; at += SECTOR) {
      const bytes = this.nor.data.subarray(at, at + SECTOR);
      if (bytes.some((byte) => byte !== 0xff)) nor.push([at, Buffer.from(bytes).toString('hex')]);
    }
    const code = [...this.flash.written].map(([at, bytes]) => [at, Buffer.from(bytes).toString('hex')]);
    return { nor, code };
  }

  /** The same, into flashes that nothing was written to yet. */
  putFlashes({ nor, code }) {
    for (const [at, bytes] of nor) this.nor.data.set(Buffer.from(bytes, 'hex'), at);
    for (const [at, hex] of code) {
      const bytes = Buffer.from(hex, 'hex');
      this.chip.rom.change(at, bytes.length, (_, i) => bytes[i]);
    }
  }

  note(pin, level, chip) {
    const now = chip.stamp >= 0 ? chip.stamp : chip.now;
    this.outputs.push([pin, level, chip.epoch + chip.base + Math.floor(now)]);
    if (this.outputs.length > OUTPUTS_KEPT) this.outputs.splice(0, OUTPUTS_KEPT / 2);
  }

  powerOff(programmed = null) {
    if (this.chip === null) return;
    this.nor.powerDown(programmed);
    this.elapsed = this.cycle;
    this.chip.resetRequested = 'power';
    this.chip = null;
    this.control.uart = null;
    this.usb.chip = null;
    this.usb.lose();
  }

  /** Runs to a cycle, through resets; less far only without power. */
  run(until) {
    while (this.chip !== null && this.cycle < until) {
      const { chip } = this;
      chip.run(until - chip.epoch);
      if (chip.resetRequested !== null && this.chip === chip) this.restart(chip);
    }
  }

  /** The chip resets itself, or its RUN pin does. */
  restart(chip = this.chip) {
    const why = chip.resetRequested ?? 'RUN pin';
    const { fault, faultCycle } = chip.core;
    this.resets.push({ why, cycle: this.cycle, fault, fault_cycle: faultCycle });
    const reason = { 'watchdog timer': 1, watchdog: 2 }[why] ?? 0;
    const scratch = chip.scratch.slice();
    const memory = chip.memory.slice();
    this.usb.lose();
    this.start({ powerOn: false, reason, scratch, memory });
  }
}
