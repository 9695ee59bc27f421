// A serial NOR flash as the Winbond W25Q128JV (data sheet revision F), on SPI0.
//
// Contents survive a power cycle and a reset of the board. Programming only clears bits and
// wraps in its page of 256 bytes; programs and erases take emulated time, in which only the
// status can be read. A power cut in the middle leaves what a cut leaves: bytes before it done,
// one half done, the rest untouched; a sector half erased.

export const SIZE = 16 * 1024 * 1024;
const PAGE = 256;
const BUSY = 1, WRITE_ENABLED = 2;
const ERASES = { 0x20: 4096, 0x52: 32768, 0xd8: 65536 };
/** Typical times of the data sheet's table 9.6, in microseconds. */
const ERASE_MICROS = { 4096: 45000, 32768: 120000, 65536: 150000 };
const PROGRAM_MICROS_FIRST_BYTE = 30, PROGRAM_MICROS_BYTE = 2.5;
const CYCLES_PER_MICRO = 125;

export class Nor {
  constructor(uniqueId) {
    this.data = new Uint8Array(SIZE).fill(0xff);
    this.uniqueId = uniqueId;
    /** Programmed bytes until the power is cut; null: never. */
    this.cutAfter = null;
    this.onCut = null;
    /** How much of the data sheet's time an erase takes. */
    this.eraseShare = 1;
    this.programs = 0;
    this.erases = 0;
    this.random = 0x2545f491;
    this.powerUp(null);
  }

  /** The board has power again, or is taken into another chip's hands. */
  powerUp(chip) {
    this.chip = chip;
    this.selected = false;
    this.command = [];
    this.count = 0;
    this.enabled = false;
    this.resetArmed = false;
    this.job = null;
    this.alarm = chip?.clock.createAlarm(() => this.complete(this.job.size));
  }

  select(isSelected) {
    if (isSelected === this.selected) return;
    this.selected = isSelected;
    if (isSelected) {
      this.command = [];
      this.count = 0;
    } else this.end();
  }

  get busy() {
    return this.job !== null;
  }

  /** One byte in, one byte out. */
  exchange(byte) {
    if (!this.selected) return 0xff;
    const at = this.count++;
    const code = at === 0 ? byte : this.command[0];
    // What a read clocks in is nobody's.
    if (at < 4 || code === 0x02) this.command.push(byte);
    if (at === 0) return 0xff;
    if (code === 0x05) return this.status;
    if (this.busy) return 0xff;
    switch (code) {
      case 0x35: case 0x15: return 0;
      case 0x9f: return [0xef, 0x40, 0x18][(at - 1) % 3];
      case 0x90: return at >= 4 ? [0xef, 0x17][(at - 4) % 2] : 0xff;
      case 0x4b: return at >= 5 ? this.uniqueId[(at - 5) % 8] : 0xff;
      case 0x03: return at >= 4 ? this.data[(this.address + at - 4) % SIZE] : 0xff;
      case 0x0b: return at >= 5 ? this.data[(this.address + at - 5) % SIZE] : 0xff;
    }
    return 0xff;
  }

  get address() {
    return ((this.command[1] << 16) | (this.command[2] << 8) | this.command[3]) % SIZE;
  }

  get status() {
    return (this.busy ? BUSY : 0) | (this.enabled ? WRITE_ENABLED : 0);
  }

  /** Chip select rises: what was clocked in is done. */
  end() {
    const [code] = this.command;
    const { length } = this.command;
    if (code === undefined || (this.busy && code !== 0x66 && code !== 0x99)) return;
    const armed = this.resetArmed;
    this.resetArmed = false;
    switch (code) {
      case 0x06: this.enabled = true; break;
      case 0x04: this.enabled = false; break;
      case 0x66: this.resetArmed = true; break;
      case 0x99:
        if (armed) {
          this.abandon();
          this.enabled = false;
        }
        break;
      case 0x02:
        if (this.enabled && length > 4) {
          const bytes = this.command.slice(4);
          const micros = PROGRAM_MICROS_FIRST_BYTE + PROGRAM_MICROS_BYTE * Math.min(bytes.length, PAGE);
          this.begin({ kind: 'program', address: this.address, bytes, size: bytes.length, micros });
        }
        break;
      case 0x20: case 0x52: case 0xd8:
        if (this.enabled && length >= 4) {
          const size = ERASES[code];
          const address = this.address - (this.address % size);
          this.begin({ kind: 'erase', address, size, micros: this.eraseShare * ERASE_MICROS[size] });
        }
        break;
      case 0x60: case 0xc7:
        if (this.enabled) this.begin({ kind: 'erase', address: 0, size: SIZE, micros: 40e6 });
        break;
    }
  }

  begin(job) {
    this.job = job;
    this.since = this.chip.cycle;
    const cycles = Math.ceil(job.micros * CYCLES_PER_MICRO);
    if (job.kind === 'program' && this.cutAfter !== null && this.cutAfter < job.size) {
      const done = this.cutAfter;
      this.cutAfter = null;
      // The power goes while this byte is programmed.
      this.chip.clock.createAlarm(() => this.onCut?.(done)).at(
        this.chip.cycle + Math.max(1, Math.floor((cycles * done) / job.size)),
      );
    } else if (job.kind === 'program' && this.cutAfter !== null) this.cutAfter -= job.size;
    this.alarm.at(this.chip.cycle + cycles);
  }

  /** The first `done` bytes of the job are as they shall be. */
  complete(done) {
    const { job } = this;
    if (job.kind === 'program') {
      const page = job.address - (job.address % PAGE);
      for (let i = 0; i < done; i++) this.data[page + ((job.address + i) % PAGE)] &= job.bytes[i];
      this.programs++;
    } else {
      this.data.fill(0xff, job.address, job.address + done);
      this.erases++;
    }
    this.job = null;
    this.enabled = false;
  }

  /** A job that is cut short. */
  abandon(done = null) {
    const { job } = this;
    if (job === null) return;
    this.alarm.cancel();
    const share = (this.chip.cycle - this.since) / (job.micros * CYCLES_PER_MICRO);
    const whole = done ?? Math.min(job.size - 1, Math.floor(share * job.size));
    if (job.kind === 'program') {
      this.complete(whole);
      const page = job.address - (job.address % PAGE);
      this.data[page + ((job.address + whole) % PAGE)] &= job.bytes[whole] | this.noise();
    } else {
      // An erase acts on all cells at once: some have flipped.
      for (let i = 0; i < job.size; i++) this.data[job.address + i] |= this.noise();
      this.job = null;
    }
  }

  /** The power goes. `done`: how many bytes of the program under way are through. */
  powerDown(done = null) {
    if (this.job !== null) this.abandon(done);
    this.selected = false;
  }

  noise() {
    this.random = Math.imul(this.random, 1664525) + 1013904223;
    return (this.random >>> 16) & 0xff;
  }
}

/** Puts the flash on a chip's SPI0, selected by a pin. */
export function connect(nor, chip, selectPin) {
  nor.powerUp(chip);
  const spi = chip.rp.spi[0];
  let answer = 0;
  const done = chip.clock.createAlarm(() => spi.completeTransmit(answer));
  spi.onTransmit = (value) => {
    answer = nor.exchange(value & 0xff);
    const cycles = (spi.dataBits * chip.rp.clkSys) / (spi.clockFrequency || chip.rp.clkPeri);
    done.at(Math.ceil(chip.cycle + cycles));
  };
  const pin = chip.rp.gpio[selectPin];
  pin.addListener(() => nor.select(pin.outputEnable && !pin.outputValue));
}
