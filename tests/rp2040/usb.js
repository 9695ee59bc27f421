// The host at the other end of the board's USB: enumerates a CDC-ACM device and exchanges bytes.
//
// rp2040js' controller completes every buffer the moment it is made available, so that a device
// never waits for its host and reads what was never sent. Here a buffer stays available (RP2040
// datasheet 4.1.2.5) until the host's transaction on it, which takes the time it takes on a
// full-speed bus; an unplugged host, or one whose program has not opened the port, takes nothing.
// SUSPENDED is cleared by writing it (4.1.4, SIE_STATUS). Data toggles are checked. SOF_RD counts the
// frames that a host sends each millisecond, while the board's pull-up shows it and the port is on.
//
// Two faults of a host, which end when the board is gone and comes back: it never enumerates the board
// (`unheard`), or its hub has disabled the port (`disable`).

const AVAILABLE = 1 << 10, STALL = 1 << 11, DATA1 = 1 << 13, FULL = 1 << 15, LENGTH = 0x3ff;
const EP0_IN = 0x80;
const PULLUP = 1 << 16;
const SUSPENDED = 1 << 4, CONNECTED = 1 << 16, BUS_RESET = 1 << 19;
const SIE_STATUS = 0x50, SOF_RD = 0x48;
const FRAMES = 0x7ff;
const CYCLES_PER_MICRO = 125;
const MS = 1000 * CYCLES_PER_MICRO;
const IDLE = 'idle';
const GET = 0x80, SET = 0x00, CLASS = 0x21;
const DEVICE = 1, CONFIGURATION = 2, STRING = 3, INTERFACE = 4, ENDPOINT = 5;
const PACKETS_KEPT = 1 << 16;
const CDC_COMMUNICATION = 2, CDC_DATA = 10, BULK = 2;

export class UsbHost {
  constructor() {
    this.plugged = true;
    /** Whether a program on the host has the port open. */
    this.open = false;
    this.queue = [];
    this.head = 0;
    this.onData = null;
    /** The device is gone from the host. */
    this.onGone = null;
    /** Whether the program takes bytes now. */
    this.takes = () => true;
    /** Packets with bytes: cycle, and how many came from the board or, below zero, went to it. */
    this.packets = [];
    this.received = 0;
    this.delivered = 0;
    this.toggleErrors = 0;
    this.enumerations = 0;
    this.failure = null;
    /** Of the next enumeration nothing comes. */
    this.isUnheard = false;
    /** The hub has switched the port off. */
    this.isDisabled = false;
    this.frame = 0;
    this.forget();
  }

  /** The port is off until the device has been gone. */
  disable() {
    this.isDisabled = true;
    this.lose();
    this.alarm.cancel();
    this.suspendAlarm.at(this.chip.cycle + 3 * MS);
  }

  /** The host takes part: there are frames and transactions. */
  get isThere() {
    return this.plugged && !this.isDisabled;
  }

  forget() {
    this.configured = false;
    this.descriptors = {};
    this.transfers = [];
    this.transfer = null;
    this.stage = IDLE;
    this.inEndpoint = 0;
    this.outEndpoint = 0;
    this.interface = 0;
    this.expected = 0;
    this.given = 0;
  }

  /** The device is gone: unplugged, or without power. */
  lose() {
    this.forget();
    this.onGone?.();
  }

  /** Takes the USB controller of a chip out of reset. */
  connect(chip) {
    this.chip = chip;
    this.forget();
    const usb = chip.rp.usbCtrl;
    this.usb = usb;
    this.view = chip.rp.usbDPRAMView;
    this.bytes = chip.rp.usbDPRAM;
    this.pulledUp = false;
    this.alarm = chip.clock.createAlarm(() => this.turn());
    this.attachAlarm = chip.clock.createAlarm(() => this.reset());
    this.suspendAlarm = chip.clock.createAlarm(() => this.suspend());
    usb.DPRAMUpdated = (offset, value) => {
      if (offset >= EP0_IN && offset < EP0_IN + 128 && value & (AVAILABLE | STALL)) this.kick();
    };
    const control = usb.handleSieCtrlWrite;
    usb.handleSieCtrlWrite = (value) => {
      control.call(usb, value);
      const was = this.pulledUp;
      this.pulledUp = (value & PULLUP) !== 0;
      if (this.pulledUp && !was) this.attach();
      if (!this.pulledUp && was) this.detach();
    };
    const read = usb.readUint32;
    usb.readUint32 = (offset) => (offset === SOF_RD ? this.frames() : read.call(usb, offset));
    const write = usb.writeUint32;
    usb.writeUint32 = (offset, value) => {
      if (offset === SIE_STATUS) usb.sieStatus &= ~(usb.rawWriteValue & SUSPENDED);
      write.call(usb, offset, value);
    };
    usb.onResetReceived = () => this.enumerate();
  }

  plug(isPlugged) {
    if (isPlugged === this.plugged) return;
    this.plugged = isPlugged;
    this.lose();
    this.alarm.cancel();
    this.attachAlarm.cancel();
    // A device that hears no frames is suspended after 3 ms.
    if (isPlugged) this.attach();
    else this.suspendAlarm.at(this.chip.cycle + 3 * MS);
  }

  /** The number of the latest frame that has reached the device. */
  frames() {
    if (this.isThere && this.pulledUp) {
      this.frame = Math.floor((this.chip.epoch + this.chip.cycle) / MS) & FRAMES;
    }
    return this.frame;
  }

  /** The device has let go of the line. */
  detach() {
    this.isDisabled = false;
    this.lose();
    this.alarm.cancel();
    this.attachAlarm.cancel();
    this.suspendAlarm.cancel();
  }

  attach() {
    if (this.plugged && this.pulledUp) this.attachAlarm.at(this.chip.cycle + 2 * MS);
  }

  suspend() {
    if (this.isThere) return;
    this.usb.sieStatus = (this.usb.sieStatus & ~CONNECTED) | SUSPENDED;
    this.usb.sieStatusUpdated();
  }

  reset() {
    this.forget();
    this.usb.sieStatus |= BUS_RESET;
    this.usb.sieStatusUpdated();
  }

  // --- Enumeration ---

  enumerate() {
    this.forget();
    this.enumerations++;
    if (this.isUnheard) {
      this.isUnheard = false;
      return;
    }
    const d = this.descriptors;
    this.ask(GET, 6, DEVICE << 8, 0, 18, (bytes) => {
      d.device = bytes;
      if (bytes === null || bytes.length < 18) return this.fail('no device descriptor');
      this.ask(SET, 5, 1, 0, 0, () => {});
      this.ask(GET, 6, CONFIGURATION << 8, 0, 9, (head) => {
        if (head === null) return this.fail('no configuration');
        this.ask(GET, 6, CONFIGURATION << 8, 0, head[2] | (head[3] << 8), (whole) => this.configure(whole));
      });
    });
  }

  configure(bytes) {
    const d = this.descriptors;
    d.configuration = bytes;
    if (!this.findInterfaces(bytes)) return this.fail('no CDC-ACM interface in its configuration');
    for (const [name, index] of [['manufacturer', 14], ['product', 15], ['serial', 16]]) {
      if (d.device[index] === 0) continue;
      this.ask(GET, 6, (STRING << 8) | d.device[index], 0x0409, 255, (text) => {
        d[name] = text && new TextDecoder('utf-16le').decode(text.subarray(2, text[0]));
      });
    }
    this.ask(SET, 9, bytes[5], 0, 0, () => {
      this.expected = 0;
      this.given = 0;
      // 115200 baud, one stop bit, no parity, 8 bits: what a program asks for.
      const coding = Uint8Array.of(0x00, 0xc2, 0x01, 0x00, 0, 0, 8);
      this.ask(CLASS, 0x20, 0, this.interface, 0, () => {}, coding);
      this.configured = true;
      this.lineState();
      this.kick();
    });
  }

  findInterfaces(bytes) {
    let kind = 0;
    for (let at = 0; at < bytes.length && bytes[at] > 1; at += bytes[at]) {
      if (bytes[at + 1] === INTERFACE) {
        kind = bytes[at + 5];
        if (kind === CDC_COMMUNICATION) this.interface = bytes[at + 2];
      } else if (bytes[at + 1] === ENDPOINT && kind === CDC_DATA && (bytes[at + 3] & 3) === BULK) {
        if (bytes[at + 2] & 0x80) this.inEndpoint = bytes[at + 2] & 15;
        else this.outEndpoint = bytes[at + 2] & 15;
      }
    }
    return this.inEndpoint > 0 && this.outEndpoint > 0;
  }

  fail(why) {
    this.failure = why;
  }

  /** DTR and RTS follow the program that has the port. */
  lineState() {
    if (this.configured) this.ask(CLASS, 0x22, this.open ? 3 : 0, this.interface, 0, () => {});
  }

  opened(isOpen) {
    this.open = isOpen;
    if (!isOpen) {
      this.queue.length = 0;
      this.head = 0;
    }
    this.lineState();
    this.kick();
  }

  send(bytes) {
    for (const byte of bytes) this.queue.push(byte);
    this.kick();
  }

  // --- The bus ---

  ask(type, request, value, index, wants, done, data = null) {
    const length = data ? data.length : wants;
    const setup = Uint8Array.of(
      type, request, value & 255, value >> 8, index & 255, index >> 8, length & 255, length >> 8,
    );
    this.transfers.push({ setup, wants, data, done, got: [], given: 0 });
    this.kick();
  }

  kick() {
    if (this.isThere && this.chip && !this.alarm.scheduled) {
      this.alarm.at(this.chip.cycle + 5 * CYCLES_PER_MICRO);
    }
  }

  buffer(endpoint, out) {
    return EP0_IN + 8 * endpoint + (out ? 4 : 0);
  }

  isAvailable(endpoint, out) {
    return (this.view.getUint32(this.buffer(endpoint, out), true) & AVAILABLE) !== 0;
  }

  /** One transaction, if one is possible. */
  turn() {
    if (!this.isThere) return;
    const size = this.control() ?? this.bulk();
    if (size !== null) {
      // Token, data, handshake and gaps: 13 bytes beside the data, at 12 Mbit/s.
      this.alarm.at(this.chip.cycle + Math.ceil(((13 + size) * 8 * CYCLES_PER_MICRO) / 12));
    }
  }

  control() {
    if (this.stage === IDLE) {
      this.transfer = this.transfers.shift() ?? null;
      if (this.transfer === null) return null;
      for (const out of [false, true]) {
        const at = this.buffer(0, out);
        this.view.setUint32(at, this.view.getUint32(at, true) & ~(STALL | AVAILABLE), true);
      }
      this.usb.epStallArm = 0;
      this.usb.sendSetupPacket(this.transfer.setup);
      this.stage = this.transfer.wants ? 'in' : this.transfer.data ? 'out' : 'status in';
      return 8;
    }
    const { transfer } = this;
    const out = this.stage === 'out' || this.stage === 'status out';
    if (this.view.getUint32(this.buffer(0, out), true) & STALL) {
      this.stage = IDLE;
      transfer.done(null);
      return 0;
    }
    if (!this.isAvailable(0, out)) return null;
    switch (this.stage) {
      case 'in': {
        const packet = this.take(0);
        transfer.got.push(...packet);
        if (packet.length < 64 || transfer.got.length >= transfer.wants) this.stage = 'status out';
        return packet.length;
      }
      case 'out': {
        const packet = transfer.data.subarray(transfer.given, transfer.given + 64);
        transfer.given += packet.length;
        this.give(0, packet);
        if (transfer.given >= transfer.data.length) this.stage = 'status in';
        return packet.length;
      }
      case 'status in':
        this.take(0);
        break;
      case 'status out':
        this.give(0, new Uint8Array(0));
        break;
    }
    this.stage = IDLE;
    transfer.done(Uint8Array.from(transfer.got));
    return 0;
  }

  bulk() {
    if (!this.configured) return null;
    const isReceiving = this.open && this.takes() && this.isAvailable(this.inEndpoint, false);
    const isSending = this.head < this.queue.length && this.isAvailable(this.outEndpoint, true);
    if (isReceiving && !(isSending && this.wasReceiving)) {
      this.wasReceiving = true;
      const control = this.view.getUint32(this.buffer(this.inEndpoint, false), true);
      const packet = this.take(this.inEndpoint);
      if (((control & DATA1) !== 0) !== (this.expected === 1)) {
        // A repeated packet, to a host: acknowledged and thrown away.
        this.toggleErrors++;
        return packet.length;
      }
      this.expected ^= 1;
      this.received += packet.length;
      this.note(packet.length);
      if (packet.length > 0) this.onData?.(packet);
      return packet.length;
    }
    if (isSending) {
      this.wasReceiving = false;
      const control = this.view.getUint32(this.buffer(this.outEndpoint, true), true);
      if (((control & DATA1) !== 0) !== (this.given === 1)) this.toggleErrors++;
      this.given ^= 1;
      const packet = Uint8Array.from(this.queue.slice(this.head, this.head + Math.min(64, control & LENGTH)));
      this.head += packet.length;
      if (this.head > 65536) {
        this.queue.splice(0, this.head);
        this.head = 0;
      }
      this.delivered += packet.length;
      this.note(-packet.length);
      this.give(this.outEndpoint, packet);
      return packet.length;
    }
    return null;
  }

  note(length) {
    if (length === 0) return;
    this.packets.push([this.chip.epoch + this.chip.cycle, length]);
    if (this.packets.length > PACKETS_KEPT) this.packets.splice(0, PACKETS_KEPT / 2);
  }

  /** An IN transaction. */
  take(endpoint) {
    const at = this.buffer(endpoint, false);
    const control = this.view.getUint32(at, true);
    const from = this.usb.getEndpointBufferOffset(endpoint, false);
    const packet = this.bytes.slice(from, from + (control & LENGTH));
    this.view.setUint32(at, control & ~(AVAILABLE | FULL), true);
    this.usb.indicateBufferReady(endpoint, false);
    return packet;
  }

  /** An OUT transaction. */
  give(endpoint, packet) {
    const at = this.buffer(endpoint, true);
    const control = this.view.getUint32(at, true);
    this.bytes.set(packet, this.usb.getEndpointBufferOffset(endpoint, true));
    this.view.setUint32(at, (control & ~(AVAILABLE | LENGTH)) | FULL | packet.length, true);
    this.usb.indicateBufferReady(endpoint, true);
  }

  get waiting() {
    return this.queue.length - this.head;
  }
}
