// The emulated Pico: `node main.js IMAGE [--paused] [--unique-id HEX]`.
//
// When it is ready it prints one line of JSON: { "control": PORT, "host": PORT, "bench": PORT },
// TCP ports on 127.0.0.1. `control` and `host` carry plain bytes: the control's serial line, at
// its baud rate in emulated time, and the program that has opened the board's USB port (connected
// = open). The process ends when its standard input does.
//
// `bench` takes requests, each a line of JSON with `do`, and answers each with a line: the answer,
// or { "error": TEXT }. Times are cycles of 8 ns since the board first had power.
//
// | do         | with                                   | what                                          |
// | ---------- | -------------------------------------- | --------------------------------------------- |
// | state      |                                        | cycle, is_on, is_running, fault, fault_cycle, resets, led and other outputs, uart, usb, dma_aborts, nor, speed |
// | run        | cycles                                 | runs so far, then stands still; answers state  |
// | free       | speed = 1                              | runs by itself, at most `speed` times real time (0: as fast as it can) |
// | pause      |                                        | stands still                                   |
// | axis       | axis, segments, repeat, skipEvery, bounce, bounceCycles, glitch, glitchCycles, seed, after = 0 | an encoder moves (stimuli.js, Axis); answers start |
// | pulses     | pin, at or period + count + jitter, width, widths, active, record, both, seed, after = 0 | pulses (stimuli.js, Pulses); answers start |
// | level      | pin, level                             | a level that stays                             |
// | stop       |                                        | ends all motion and pulses                     |
// | axes       |                                        | per axis: position, edges, illegal, isMoving   |
// | truth      |                                        | what was recorded since asked last: rows of pin, cycle, then per axis position, cycles since its last edge, cycles to its next (-1: none) |
// | outputs    |                                        | changes since asked last: [pin, level, cycle]  |
// | power      | on                                     | power goes or comes                            |
// | reset      |                                        | the RUN pin                                    |
// | usb        | plugged                                | the USB plug                                   |
// | usb_fault  | fault                                  | `unheard`: nothing comes of the next enumeration; `disabled`: the hub switches the port off |
// | descriptors |                                       | what the host has read: device and configuration (hex), manufacturer, product, serial |
// | uart       | baud, stop_bits, rts_cts = false, after_xoff | the control's own baud rate and stop bits (null: the board's); whether it sends only while RTS lets it; how many characters it still sends after an XOFF (null: it does not obey) |
// | packets    |                                        | of the link since asked last: [cycle, bytes from the board, or below zero to it] |
// | stamps     |                                        | cycles at which the last characters to the control ended, and those from it: came |
// | send       | bytes (hex)                            | the control sends, without the TCP port in between |
// | nor_read   | address, length                        | contents (hex)                                 |
// | nor_write  | address, bytes (hex)                   | puts contents                                  |
// | nor_cut    | after                                  | cuts the power at this programmed byte (null: not) |
// | jumper     | closed                                 | closes the owner's jumper, or opens it         |
// | noise      | stuck                                  | the oscillator's bits over and over (null: as it should be) |
// | flash_read | address, length                        | contents of the flash that the code runs from (hex) |
// | flash_write | address, bytes (hex)                | changes it, as a debug probe does             |
// | flashes    | put = null                             | what both flashes hold where they are not blank; with `put` they hold that instead |
// | flash_cut  | after                                  | cuts the power within a write of that flash, behind so many (null: not); answers how many were left |
// | erase_share | share                                 | what an erase of either flash takes, of the data sheet's time |
// | memory     | address, words                         | words of the chip's memory, as numbers         |
// | memory_set | address, value                         | writes a word, as the core does                |
// | sink_stack | top, bottom, free                      | leaves so much of the stack, if the core sleeps |
// | time       |                                        | cycle, and at it timer_us, the chip's own microsecond timer; began: the cycle at which the chip came out of reset, and with it that timer |
// | interrupts |                                        | rows since asked last: number, how many, longest wait from request to entry, longest run, longest from a request to its return, in cycles |
// | no_stack   | stops                                  | whether a fault without memory for the stack stops the core, until the next reset; else the handler begins |
// | crash      |                                        | the core has a HardFault; answers cycle |
// | cache      | line_cycles, words                     | what a line of the flash costs the core from now on (cache.js; 0: nothing), or whether its words come one by one; answers hits and misses since asked last |
// | dma_hold   | cycles                                 | the bus is taken: no channel gets a transfer for so long |

import { readFileSync } from 'node:fs';
import { createServer } from 'node:net';
import { Board, JUMPER, OUTPUT_PINS } from './board.js';
import { segments } from './elf.js';
import { contents } from './rom.js';

/** Cycles at a stretch: between two, ports are looked at. */
const STRETCH = 125_000;
const STRETCH_MS = 8;
const CYCLES_PER_MS = 125_000;
const TIMER = 0x40054000;
/** More than this unsent to the host's program: it does not take more. */
const HOST_BACKLOG = 1 << 18;
const USAGE = 'usage: node main.js IMAGE [--paused] [--unique-id HEX]';
const NAMES = { 21: 'laser_enable', 22: 'trigger_out', 25: 'led', 26: 'ok', 27: 'ng', 28: 'busy' };

function options(args) {
  const found = { image: null, isPaused: false, uniqueId: 'e661640843512a37' };
  for (let i = 0; i < args.length; i++) {
    if (args[i] === '--paused') found.isPaused = true;
    else if (args[i] === '--unique-id') found.uniqueId = args[++i];
    else if (args[i].startsWith('-')) fail(`there is no option ${args[i]}; ${USAGE}`);
    else found.image = args[i];
  }
  if (found.image === null) fail(USAGE);
  if (!/^[0-9a-f]{16}$/i.test(found.uniqueId ?? '')) fail('--unique-id takes 16 hexadecimal digits');
  return found;
}

/** One line that says what is wrong. */
function fail(why) {
  console.error(why);
  process.exit(2);
}

/** A board with an image in its flash. */
function boardWith(image, uniqueId) {
  let bytes;
  try {
    bytes = readFileSync(image);
  } catch (error) {
    fail(`the image cannot be read: ${error.message}; \`cargo xtask firmware pico\` makes one`);
  }
  try {
    return new Board(segments(bytes), Buffer.from(uniqueId, 'hex'));
  } catch (error) {
    fail(`${image} is no image for this board: ${error.message}`);
  }
}

class Bench {
  constructor(board, isPaused) {
    this.board = board;
    this.speed = 1;
    this.isFree = !isPaused;
    this.runs = [];
    this.isScheduled = false;
    this.spent = 0;
    this.ran = 0;
    this.outputsAsked = 0;
    this.rebase();
    this.schedule();
  }

  rebase() {
    this.wallStart = performance.now();
    this.cycleStart = this.board.cycle;
  }

  schedule(wait = 0) {
    if (this.isScheduled) return;
    if (!this.board.isOn || (this.runs.length === 0 && !this.isFree)) return;
    this.isScheduled = true;
    const turn = () => {
      this.isScheduled = false;
      this.turn();
    };
    if (wait >= 1) setTimeout(turn, wait);
    else setImmediate(turn);
  }

  /** A stretch of emulation, then the ports. */
  turn() {
    const { board } = this;
    const began = performance.now();
    const from = board.cycle;
    let wait = 0;
    let target = Infinity;
    if (this.runs.length > 0) target = this.runs[0].until;
    else if (!this.isFree) return;
    else if (this.speed > 0) {
      const due = this.cycleStart + (began - this.wallStart) * CYCLES_PER_MS * this.speed;
      // A stretch that was late is not made up for: emulated time may fall behind.
      if (due - from > 20 * STRETCH) {
        this.rebase();
        target = from + 20 * STRETCH;
      } else target = due;
      if (target <= from) wait = 1;
    }
    while (board.isOn && board.cycle < target && performance.now() - began < STRETCH_MS) {
      board.run(Math.min(target, board.cycle + STRETCH));
    }
    this.ran += board.cycle - from;
    this.spent += performance.now() - began;
    while (this.runs.length > 0 && (board.cycle >= this.runs[0].until || !board.isOn)) {
      this.runs.shift().done();
      this.rebase();
    }
    this.schedule(wait);
  }

  answer(request) {
    const { board } = this;
    const { stimuli, nor, usb, control, chip } = board;
    switch (request.do) {
      case 'state':
        return this.state();
      case 'run':
        this.isFree = false;
        return new Promise((done) => {
          const last = this.runs.at(-1)?.until ?? board.cycle;
          this.runs.push({ until: last + request.cycles, done: () => done(this.state()) });
          if (board.isOn) this.schedule();
          else this.runs.pop().done();
        });
      case 'free':
        this.isFree = true;
        this.speed = request.speed ?? 1;
        this.rebase();
        this.schedule();
        return {};
      case 'pause':
        this.isFree = false;
        return this.state();
      case 'axis':
        if (stimuli.axes[request.axis] === undefined) {
          throw new Error(`there is no axis ${request.axis}: they are 0 to ${stimuli.axes.length - 1}`);
        }
        return { start: stimuli.startAxis(request.axis, request, request.after ?? 0) };
      case 'pulses':
        return { start: stimuli.startPulses(request, request.after ?? 0) };
      case 'level':
        stimuli.set(request.pin, request.level);
        return {};
      case 'stop':
        stimuli.stop();
        return {};
      case 'axes':
        return {
          axes: stimuli.axes.map(({ position, edges, illegal, next }) => ({
            position, edges, illegal, isMoving: next !== Infinity,
          })),
        };
      case 'truth': {
        const rows = stimuli.truth;
        stimuli.truth = [];
        return { width: 2 + 3 * stimuli.axes.length, rows };
      }
      case 'outputs': {
        const changes = board.outputs;
        board.outputs = [];
        return { changes };
      }
      case 'power':
        if (request.on) board.powerOn();
        else board.powerOff();
        this.rebase();
        this.schedule();
        return {};
      case 'reset':
        if (board.isOn) board.restart();
        return {};
      case 'usb':
        board.plugUsb(request.plugged);
        return {};
      case 'usb_fault':
        usb.isUnheard = request.fault === 'unheard';
        if (request.fault === 'disabled' && board.isOn) usb.disable();
        return {};
      case 'descriptors': {
        const { device, configuration, manufacturer, product, serial } = usb.descriptors;
        return {
          device: hex(device), configuration: hex(configuration), manufacturer, product, serial,
        };
      }
      case 'uart':
        control.baud = request.baud ?? null;
        control.stopBits = request.stop_bits ?? null;
        control.minds = request.rts_cts ?? false;
        control.afterXoff = request.after_xoff ?? null;
        control.uart?.poke();
        return {};
      case 'packets': {
        const { packets } = usb;
        usb.packets = [];
        return { packets };
      }
      case 'stamps': {
        const { stamps, came } = control;
        control.stamps = [];
        control.came = [];
        return { stamps, came };
      }
      case 'send':
        control.send(Buffer.from(request.bytes, 'hex'));
        return {};
      case 'nor_read':
        return { bytes: hex(nor.data.subarray(request.address, request.address + request.length)) };
      case 'nor_write':
        nor.data.set(Buffer.from(request.bytes, 'hex'), request.address);
        return {};
      case 'nor_cut':
        nor.cutAfter = request.after ?? null;
        return {};
      case 'jumper':
        stimuli.set(JUMPER, request.closed ? 0 : 1);
        return {};
      case 'noise':
        board.noise.stuck = request.stuck ?? null;
        return {};
      case 'flash_read':
        if (chip === null) throw new Error('the board has no power');
        return { bytes: hex(contents(chip, request.address, request.length)) };
      case 'flash_write': {
        if (chip === null) throw new Error('the board has no power');
        const bytes = Buffer.from(request.bytes, 'hex');
        chip.rom.change(request.address - 0x10000000, bytes.length, (_, i) => bytes[i]);
        return {};
      }
      case 'flashes':
        if (chip === null) throw new Error('the board has no power');
        if (request.put) board.putFlashes(request.put);
        return board.flashes();
      case 'flash_cut': {
        const { cutAfter } = board.flash;
        board.flash.cutAfter = request.after ?? null;
        return { left: cutAfter };
      }
      case 'erase_share':
        nor.eraseShare = board.flash.eraseShare = request.share;
        return {};
      case 'memory':
        if (chip === null) throw new Error('the board has no power');
        return {
          words: Array.from({ length: request.words }, (_, i) =>
            chip.core.read32(request.address + 4 * i) >>> 0),
        };
      case 'memory_set':
        if (chip === null) throw new Error('the board has no power');
        chip.core.write32(request.address, request.value);
        return {};
      case 'sink_stack':
        if (chip === null) throw new Error('the board has no power');
        return { done: chip.core.sinkStack(request.top, request.bottom, request.free) };
      case 'time':
        if (chip === null) throw new Error('the board has no power');
        return {
          cycle: board.cycle,
          began: chip.epoch,
          timer_us: 2 ** 32 * (chip.core.read32(TIMER + 0x24) >>> 0) + (chip.core.read32(TIMER + 0x28) >>> 0),
        };
      case 'interrupts':
        if (chip === null) throw new Error('the board has no power');
        return { rows: chip.core.takeInterruptTimes() };
      case 'no_stack':
        if (chip === null) throw new Error('the board has no power');
        chip.core.stopsWithoutStack = request.stops;
        return {};
      case 'crash':
        if (chip === null) throw new Error('the board has no power');
        chip.core.crash();
        return { cycle: board.cycle };
      case 'cache': {
        if (chip === null) throw new Error('the board has no power');
        const { cache } = chip.core;
        const { hits, misses } = cache.takeCounts();
        if (request.words !== undefined) cache.byWords(request.words);
        cache.lineCycles = request.line_cycles ?? cache.lineCycles;
        return { hits, misses, line_cycles: cache.lineCycles };
      }
      case 'dma_hold':
        if (chip === null) throw new Error('the board has no power');
        chip.holdTransfers(request.cycles);
        return { cycle: board.cycle };
      default:
        throw new Error(`no request is called ${request.do}`);
    }
  }

  state() {
    const { board } = this;
    const { chip, usb, control, nor } = board;
    const outputs = {};
    for (const pin of OUTPUT_PINS) {
      const { outputEnable = false, outputValue = false } = chip?.rp.gpio[pin] ?? {};
      outputs[NAMES[pin]] = outputEnable && outputValue;
    }
    return {
      cycle: board.cycle,
      is_on: board.isOn,
      is_running: this.isFree || this.runs.length > 0,
      fault: chip?.core.fault ?? null,
      fault_cycle: chip?.core.faultCycle ?? null,
      resets: board.resets,
      outputs,
      core: {
        pc: chip === null ? 0 : chip.rp.core.PC >>> 0,
        instructions: chip?.core.instructions ?? 0,
        slept_cycles: chip?.slept ?? 0,
      },
      uart: {
        baud: chip === null ? 0 : control.uart.baud,
        heard: control.heard,
        sent: control.sent,
        waiting: control.waiting,
        overruns: control.overruns,
        unheard: control.unheard,
        held: control.held,
      },
      usb: {
        plugged: usb.plugged,
        pulled_up: usb.pulledUp,
        configured: usb.configured,
        open: usb.open,
        received: usb.received,
        delivered: usb.delivered,
        waiting: usb.waiting,
        toggle_errors: usb.toggleErrors,
        enumerations: usb.enumerations,
        failure: usb.failure,
      },
      dma_aborts: chip?.aborts ?? null,
      nor: { busy: nor.busy, programs: nor.programs, erases: nor.erases },
      cycles_per_second: this.spent ? Math.round((this.ran / this.spent) * 1000) : 0,
    };
  }
}

function hex(bytes) {
  return bytes ? Buffer.from(bytes).toString('hex') : null;
}

/** A port for one client at a time; the one that comes last has it. */
function serve(onClient) {
  return new Promise((ready) => {
    const server = createServer((socket) => {
      socket.setNoDelay(true);
      socket.on('error', () => {});
      onClient(socket);
    });
    server.listen(0, '127.0.0.1', () => ready(server.address().port));
  });
}

function serveControl(board, bench) {
  let client = null;
  board.control.onByte = (byte) => client?.write(Uint8Array.of(byte));
  return serve((socket) => {
    client?.destroy();
    client = socket;
    socket.on('data', (bytes) => {
      board.control.send(bytes);
      bench.schedule();
    });
    socket.on('close', () => {
      if (client === socket) client = null;
    });
  });
}

function serveHost(board, bench) {
  let client = null;
  board.usb.takes = () => client !== null && client.writableLength < HOST_BACKLOG;
  board.usb.onData = (bytes) => client?.write(bytes);
  // A serial device that goes takes its open files with it.
  board.usb.onGone = () => client?.destroy();
  return serve((socket) => {
    client?.destroy();
    client = socket;
    board.usb.opened(true);
    socket.on('data', (bytes) => {
      board.usb.send(bytes);
      bench.schedule();
    });
    socket.on('drain', () => board.usb.kick());
    socket.on('close', () => {
      if (client === socket) {
        client = null;
        board.usb.opened(false);
      }
    });
  });
}

function serveBench(bench) {
  return serve((socket) => {
    let text = '';
    // One after the other, in their order.
    let last = Promise.resolve();
    socket.on('data', (bytes) => {
      text += bytes;
      const lines = text.split('\n');
      text = lines.pop();
      for (const line of lines) {
        if (line.trim() === '') continue;
        last = last.then(async () => {
          let answer;
          try {
            answer = await bench.answer(JSON.parse(line));
          } catch (error) {
            answer = { error: error.message };
          }
          socket.write(`${JSON.stringify(answer)}\n`);
        });
      }
    });
  });
}

const { image, isPaused, uniqueId } = options(process.argv.slice(2));
const board = boardWith(image, uniqueId);
const bench = new Bench(board, isPaused);
const [control, host, benchPort] = await Promise.all([
  serveControl(board, bench),
  serveHost(board, bench),
  serveBench(bench),
]);
console.log(JSON.stringify({ control, host, bench: benchPort }));
process.stdin.on('end', () => process.exit(0));
process.stdin.resume();
