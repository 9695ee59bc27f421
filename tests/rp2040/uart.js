// A PL011 whose bytes take the time they take, and the control at the other end of its wires.
//
// rp2040js sends a byte at once, has no transmitter state, no overrun and always a FIFO of 32.
// This is the PL011 by its TRM (ARM DDI 0183G): 3.3.6 data and error flags, 3.3.8 flag register,
// 2.4.2 and 3.3.12 FIFOs off (one character each way beside the shifter) and on (32 deep), 2.4.3
// requests to the DMA for what has come, 2.8
// interrupts: transmit on the transition through the level, receive, receive timeout, overrun.

import { BasePeripheral } from 'rp2040js';

const DR = 0x00, RSR = 0x04, FR = 0x18, IBRD = 0x24, FBRD = 0x28, LCR_H = 0x2c, CR = 0x30;
const IFLS = 0x34, IMSC = 0x38, RIS = 0x3c, MIS = 0x40, ICR = 0x44, DMACR = 0x48;
const FR_CTS = 1 << 0, FR_BUSY = 1 << 3, FR_RXFE = 1 << 4, FR_TXFF = 1 << 5, FR_RXFF = 1 << 6, FR_TXFE = 1 << 7;
const INT_RX = 1 << 4, INT_TX = 1 << 5, INT_RT = 1 << 6, INT_OE = 1 << 10;
const CR_EN = 1, CR_LBE = 1 << 7, CR_TXE = 1 << 8, CR_RXE = 1 << 9, CR_RTS = 1 << 11, CR_CTSEN = 1 << 15;
const DR_OE = 1 << 11;
const RXDMAE = 1;
/** UART 0 is the only one that the board has (RP2040 datasheet 2.5.3.1). */
const DREQ_RX = 21;
const FEN = 1 << 4;
const FIFO_DEPTH = 32;
const ID = [0x11, 0x10, 0x34, 0x00, 0x0d, 0xf0, 0x05, 0xb1];
const CTS_PIN = 2, RTS_PIN = 3;
const UART_FUNCTION = 2;

export class Uart extends BasePeripheral {
  /** `control` is the other end: `take(byte, cycle)` and `give()`. */
  constructor(chip, control, irq) {
    super(chip.rp, 'UART0');
    this.chip = chip;
    this.irq = irq;
    this.control = control;
    this.registers = { ibrd: 0, fbrd: 0, lcr: 0, cr: CR_TXE | CR_RXE, ifls: 0x12, imsc: 0, dmacr: 0 };
    this.raw = 0;
    this.rx = [];
    this.tx = [];
    this.overrun = false;
    this.shifting = -1;
    /** When the character in the shifter began, to the fraction of a cycle. */
    this.start = null;
    this.receiving = -1;
    this.txAlarm = chip.clock.createAlarm(() => this.sent());
    this.rxAlarm = chip.clock.createAlarm(() => this.received());
    this.idleAlarm = chip.clock.createAlarm(() => this.timedOut());
  }

  /** rp2040js tells of a new clock; what it makes of a bit is worked out when it is needed. */
  clkPeriChanged() {}

  get hasFifos() {
    return (this.registers.lcr & FEN) !== 0;
  }

  /** Its output is led to its input inside the chip, RTS to CTS too (TRM 3.3.8, LBE). */
  get isLooped() {
    return (this.registers.cr & CR_LBE) !== 0;
  }

  get depth() {
    return this.hasFifos ? FIFO_DEPTH : 1;
  }

  get bitCycles() {
    const { ibrd, fbrd } = this.registers;
    return 16 * (ibrd + fbrd / 64) * (this.chip.rp.clkSys / this.chip.rp.clkPeri);
  }

  get baud() {
    return this.registers.ibrd ? this.chip.clock.frequency / this.bitCycles : 0;
  }

  get stopBits() {
    return this.registers.lcr & 8 ? 2 : 1;
  }

  /** With so many stop bits: a receiver looks at the first alone (TRM 3.3.7, STP2). */
  bits(stopBits) {
    const { lcr } = this.registers;
    return 1 + (5 + ((lcr >> 5) & 3)) + (lcr & 2 ? 1 : 0) + stopBits;
  }

  get characterBits() {
    return this.bits(this.stopBits);
  }

  level(shift) {
    return [4, 8, 16, 24, 28][(this.registers.ifls >> shift) & 7] ?? 28;
  }

  get maySend() {
    const { cr } = this.registers;
    if (!(cr & CR_EN && cr & CR_TXE)) return false;
    return !(cr & CR_CTSEN) || this.clearToSend;
  }

  /** The control's RTS at our CTS pin: asserted when low. */
  get clearToSend() {
    if (this.isLooped) return (this.registers.cr & CR_RTS) !== 0;
    return !((this.chip.pins.read(this.chip.now) >>> CTS_PIN) & 1);
  }

  /** Our RTS at the control's CTS: low, as the board drives it. */
  get requestsToSend() {
    const isConnected = this.chip.rp.gpio[RTS_PIN].functionSelect === UART_FUNCTION;
    return isConnected && (this.registers.cr & CR_RTS) !== 0;
  }

  // --- Transmitter ---

  begin() {
    if (this.shifting >= 0 || this.tx.length === 0) return;
    if (!this.maySend) {
      // Held by CTS: asked again a bit later.
      this.start = null;
      if (this.registers.cr & CR_EN) this.txAlarm.at(this.chip.cycle + Math.ceil(this.bitCycles));
      return;
    }
    const before = this.tx.length;
    this.shifting = this.tx.shift();
    const level = this.hasFifos ? this.level(0) : 0;
    if (before > level && this.tx.length <= level) this.raw |= INT_TX;
    this.start ??= this.chip.cycle;
    this.txAlarm.at(Math.ceil(this.start + this.characterBits * this.bitCycles));
  }

  sent() {
    if (this.shifting >= 0) {
      // The next character follows without a gap, to the fraction of a cycle.
      this.start += this.characterBits * this.bitCycles;
      const byte = this.shifting;
      this.shifting = -1;
      if (this.isLooped) this.take(byte);
      else this.control.take(byte, this.chip.epoch + this.chip.cycle);
    }
    if (this.tx.length === 0) this.start = null;
    this.begin();
    this.checkInterrupts();
  }

  // --- Receiver ---

  /** The control may have something to send. */
  poke() {
    if (this.receiving >= 0 || this.rxAlarm.scheduled) return;
    const next = this.control.give();
    if (next === null) return;
    this.receiving = next.byte;
    this.rxAlarm.at(Math.ceil(this.chip.cycle + next.cycles));
  }

  received() {
    const byte = this.receiving;
    this.receiving = -1;
    if (byte >= 0 && this.isLooped) this.control.unheard++;
    else if (byte >= 0) {
      this.control.note(this.chip.epoch + this.chip.cycle);
      this.take(byte);
    }
    this.poke();
  }

  /** A character has come in. */
  take(byte) {
    const { cr } = this.registers;
    if (cr & CR_EN && cr & CR_RXE) {
      if (this.rx.length >= this.depth) {
        this.overrun = true;
        this.control.overruns++;
        this.raw |= INT_OE;
      } else {
        this.rx.push(byte);
        // There was room for it: what is lost is told with what came before.
        this.overrun = false;
      }
      if (this.rx.length >= (this.hasFifos ? this.level(3) : 1)) this.raw |= INT_RX;
      if (this.hasFifos) this.idleAlarm.at(this.chip.cycle + Math.ceil(32 * this.bitCycles));
      this.checkInterrupts();
    } else this.control.unheard++;
  }

  timedOut() {
    if (this.rx.length > 0) {
      this.raw |= INT_RT;
      this.checkInterrupts();
    }
  }

  checkInterrupts() {
    this.rp2040.setInterrupt(this.irq, (this.raw & this.registers.imsc) !== 0);
    this.updateDMARx();
  }

  /** With its FIFO off each character is a request of its own (TRM 2.4.3: single transfers). */
  updateDMARx() {
    const { dma } = this.chip.rp;
    const asks = this.registers.dmacr & RXDMAE && this.rx.length > 0 && !this.chip.areTransfersHeld;
    if (asks) dma.setDREQ(DREQ_RX);
    else dma.clearDREQ(DREQ_RX);
  }

  // --- Registers ---

  readUint32(offset) {
    const r = this.registers;
    switch (offset) {
      case DR: {
        // Of no character in particular: lost since there was no room, behind what is read now.
        const value = (this.rx.shift() ?? 0) | (this.overrun ? DR_OE : 0);
        if (this.rx.length < (this.hasFifos ? this.level(3) : 1)) this.raw &= ~INT_RX;
        if (this.rx.length === 0) this.raw &= ~INT_RT;
        this.checkInterrupts();
        return value;
      }
      case RSR: return this.overrun ? 8 : 0;
      case FR:
        return (
          (this.clearToSend ? FR_CTS : 0) |
          (this.shifting >= 0 || this.tx.length > 0 ? FR_BUSY : 0) |
          (this.rx.length === 0 ? FR_RXFE : 0) |
          (this.tx.length >= this.depth ? FR_TXFF : 0) |
          (this.rx.length >= this.depth ? FR_RXFF : 0) |
          (this.tx.length === 0 ? FR_TXFE : 0)
        );
      case IBRD: return r.ibrd;
      case FBRD: return r.fbrd;
      case LCR_H: return r.lcr;
      case CR: return r.cr;
      case IFLS: return r.ifls;
      case IMSC: return r.imsc;
      case RIS: return this.raw;
      case MIS: return this.raw & r.imsc;
      case DMACR: return r.dmacr;
    }
    if (offset >= 0xfe0) return ID[(offset - 0xfe0) >> 2];
    return 0;
  }

  writeUint32(offset, value) {
    const r = this.registers;
    switch (offset) {
      case DR:
        if (this.tx.length < this.depth) {
          this.tx.push(value & 0xff);
          if (this.tx.length > (this.hasFifos ? this.level(0) : 0)) this.raw &= ~INT_TX;
          this.begin();
        }
        break;
      case RSR: this.overrun = false; break;
      case IBRD: r.ibrd = value & 0xffff; break;
      case FBRD: r.fbrd = value & 0x3f; break;
      case LCR_H: r.lcr = value & 0xff; break;
      case CR:
        r.cr = value & 0xffff;
        this.begin();
        this.poke();
        break;
      case IFLS: r.ifls = value & 0x3f; break;
      case IMSC: r.imsc = value & 0x7ff; break;
      case ICR: this.raw &= ~this.rawWriteValue; break;
      case DMACR: r.dmacr = value & 7; break;
    }
    this.checkInterrupts();
  }
}

/**
 * The control: sends what is queued at its own baud rate (the board's, unless told) and collects
 * what the board sends, with the cycle at which the last bit of each character had come.
 */
export class Control {
  constructor() {
    this.queue = [];
    this.head = 0;
    this.baud = null;
    /** What it sends behind each character; null: as the board is set. */
    this.stopBits = null;
    /** It sends only while the board's RTS lets it. */
    this.minds = false;
    /** So many characters it sends after an XOFF, until an XON; null: whatever it is told. */
    this.afterXoff = null;
    /** What it may send before the next XON. */
    this.allowed = Infinity;
    /** XOFFs it has obeyed. */
    this.held = 0;
    this.overruns = 0;
    this.unheard = 0;
    this.sent = 0;
    this.heard = 0;
    this.bytes = [];
    this.stamps = [];
    /** The same of what it has sent. */
    this.came = [];
    this.uart = null;
    /** Whether the board hears it: the plug is in. */
    this.onByte = null;
  }

  send(bytes) {
    for (const byte of bytes) this.queue.push(byte);
    this.uart?.poke();
  }

  get waiting() {
    return this.queue.length - this.head;
  }

  give() {
    if (this.head >= this.queue.length || !this.uart.registers.ibrd) return null;
    if (this.minds && !this.uart.requestsToSend) return null;
    if (this.allowed === 0) return null;
    this.allowed--;
    const byte = this.queue[this.head++];
    if (this.head === this.queue.length) {
      this.queue.length = 0;
      this.head = 0;
    }
    this.sent++;
    const bit = this.baud ? this.uart.chip.clock.frequency / this.baud : this.uart.bitCycles;
    return { byte, cycles: this.uart.bits(this.stopBits ?? this.uart.stopBits) * bit };
  }

  /** A character of its own is over at this cycle. */
  note(cycle) {
    this.came.push(cycle);
    if (this.came.length > 4096) this.came.splice(0, 2048);
  }

  take(byte, cycle) {
    this.heard++;
    this.stamps.push(cycle);
    if (this.stamps.length > 4096) this.stamps.splice(0, 2048);
    if (this.afterXoff !== null && (byte & 0x7f) === 0x13) {
      this.allowed = this.afterXoff;
      this.held++;
    } else if ((byte & 0x7f) === 0x11) {
      this.allowed = Infinity;
      this.uart.poke();
    }
    this.onByte?.(byte);
  }
}
