// The state machines and the UART against rp2040js's own, which others wrote. Run by `node --test`.
//
// Beside each other: random programs, the programs of the board's image (if UMI_PICO_IMAGE names
// one) on random pins, and random bytes. What rp2040js leaves out or has otherwise than the
// datasheet is not compared: waiting (its machines wait on a timer of their own), `out` of 32 bits
// (it keeps the OSR as it was), `iffull` and `ifempty` without autopush and autopull.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import { RP2040 } from 'rp2040js';
import { Board } from './board.js';
import { Chip } from './chip.js';
import { segments } from './elf.js';
import { SYNC_CYCLES } from './pins.js';

const PIO0 = 0x50200000, UART0 = 0x40034000;
/** A pad whose input is on. */
const INPUT_ON = 0x56;
const CLKDIV = 0x00, EXECCTRL = 0x04, SHIFTCTRL = 0x08, PINCTRL = 0x14;
const JOIN = 0xc0000000;

let seed = 2463534242;
function random(below = 2 ** 32) {
  seed ^= seed << 13;
  seed ^= seed >>> 17;
  seed ^= seed << 5;
  return (seed >>> 0) % below;
}

function sleeper() {
  const words = new Uint32Array(48);
  words[0] = 0x20040000;
  words[1] = 0x10000181;
  const bytes = new Uint8Array(256);
  bytes.set(new Uint8Array(words.buffer), 0);
  bytes.set(new Uint8Array(Uint16Array.of(0xbf20, 0xbf20, 0xe7fc).buffer), 0x80);
  return [{ address: 0x10000100, bytes }];
}

/** A machine of rp2040js whose pins are inputs that are seen. */
function theirs() {
  const rp = new RP2040();
  for (const pin of rp.gpio) pin.padValue = INPUT_ON;
  return rp;
}

function setLevels(rp, levels) {
  rp.gpio.forEach((pin, index) => pin.setInputValue(((levels >>> index) & 1) === 1));
}

/** Gives both machines a program and its settings, and everything else at zero. */
function load(mine, their, { instructions, exec, shift, pins, x = 0, y = 0, osr = 0, pc = 0 }) {
  for (const machine of [mine, their]) {
    instructions.forEach((op, at) => (machine.pio.instructions[at] = op));
    machine.pio.irq = 0;
    machine.writeUint32(CLKDIV, 1 << 16);
    machine.writeUint32(EXECCTRL, exec);
    machine.writeUint32(SHIFTCTRL, shift & ~JOIN);
    machine.writeUint32(PINCTRL, pins);
    Object.assign(machine, { x, y, pc });
    for (const fifo of [machine.rxFIFO, machine.txFIFO]) while (!fifo.empty) fifo.pull();
  }
  // Its registers are signed.
  Object.assign(mine, { x: x | 0, y: y | 0, isr: 0, inCount: 0, osr: osr | 0, outCount: 32, program: null });
  Object.assign(their, {
    inputShiftReg: 0, inputShiftCount: 0, outputShiftReg: osr, outputShiftCount: 32, waiting: false,
  });
}

function look(mine, their) {
  const a = {
    pc: mine.pc, x: mine.x >>> 0, y: mine.y >>> 0, isr: mine.isr >>> 0, osr: mine.osr >>> 0,
    inCount: mine.inCount, outCount: mine.outCount, irq: mine.pio.irq & 0xff,
    values: mine.pio.pinValues >>> 0, directions: mine.pio.pinDirections >>> 0,
    rx: mine.rxFIFO.itemCount, tx: mine.txFIFO.itemCount,
  };
  const b = {
    pc: their.pc, x: their.x >>> 0, y: their.y >>> 0, isr: their.inputShiftReg >>> 0,
    osr: their.outputShiftReg >>> 0, inCount: their.inputShiftCount, outCount: their.outputShiftCount,
    irq: their.pio.irq & 0xff, values: their.pio.pinValues >>> 0,
    directions: their.pio.pinDirections >>> 0,
    rx: their.rxFIFO.itemCount, tx: their.txFIFO.itemCount,
  };
  return [a, b];
}

/** An instruction that does not wait, with a delay. */
function instruction(automatic) {
  const delay = random(4) === 0 ? random(32) << 8 : 0;
  const conditional = automatic ? random(2) << 6 : 0;
  switch (random(8)) {
    case 0: return delay | random(256);
    case 1: return 0x4000 | delay | [0, 1, 2, 3, 6, 7][random(6)] << 5 | random(32);
    case 2: return 0x6000 | delay | random(7) << 5 | 1 + random(31);
    case 3: return 0x8000 | delay | conditional;
    case 4: return 0x8080 | delay | conditional;
    case 5: return 0xa000 | delay | [0, 1, 2, 5, 6, 7][random(6)] << 5 | random(3) << 3 | [0, 1, 2, 3, 5, 6, 7][random(7)];
    case 6: return 0xc000 | delay | random(2) << 6 | random(2) << 4 | random(8);
    default: return 0xe000 | delay | [0, 1, 2, 4][random(4)] << 5 | random(32);
  }
}

test('random programs do the same, in the same number of cycles', () => {
  const levels = random();
  const chip = new Chip(sleeper(), { levels, fill() {} });
  const rp = theirs();
  setLevels(rp, levels);
  let steps = 0;
  for (let program = 0; program < 400; program++) {
    const index = random(4);
    const mine = chip.rp.pio[0].machines[index];
    const their = rp.pio[0].machines[index];
    const automatic = random(2);
    const wrap = random(32);
    const settings = {
      instructions: Array.from({ length: 32 }, () => instruction(automatic)),
      exec: (random(32) << 24 | wrap << 12 | random(wrap + 1) << 7 | random(2) << 4 | random(6)) >>> 0,
      shift: (automatic * (3 << 16) | random(4) << 18 | random() & 0x3ff00000) >>> 0,
      pins: ((1 + random(5)) << 26 | random(33) << 20 | random(32) << 15 | random(32) << 5 | random(32)) >>> 0,
      x: random(4), y: random(), osr: random(), pc: random(32),
    };
    load(mine, their, settings);
    for (let step = 0; step < 200; step++, steps++) {
      const word = random();
      if (!mine.txFIFO.full) mine.txFIFO.push(word);
      if (!their.txFIFO.full) their.txFIFO.push(word);
      const op = settings.instructions[mine.pc];
      mine.t = 100;
      mine.k = 0;
      mine.run(101, false);
      const before = their.cycles;
      their.step();
      const what = `program ${program}, step ${step}: ${op.toString(16)}`;
      assert.deepEqual(...look(mine, their), what);
      assert.equal(mine.t - 100, their.cycles - before, `${what}: cycles`);
      if (!mine.rxFIFO.empty) assert.equal(mine.rxFIFO.pull() >>> 0, their.rxFIFO.pull() >>> 0, what);
    }
  }
  assert.equal(steps, 80_000);
});

const image = process.env.UMI_PICO_IMAGE;
test("the board's programs do the same on random pins", { skip: !image && 'no UMI_PICO_IMAGE' }, () => {
  const board = new Board(segments(readFileSync(image)), Buffer.from('0123456789abcdef', 'hex'));
  const running = () => board.chip.rp.pio.every((pio) => pio.machines.every((machine) => machine.enabled));
  while (!running()) {
    assert.ok(board.cycle < 125_000_000, 'the board starts its machines within a second');
    board.run(board.cycle + 10_000);
  }
  const compared = board.chip.rp.pio.flatMap((pio) => pio.machines.map((machine) => follow(pio, machine)));
  assert.equal(compared.length, 8);
  assert.ok(compared.every((steps) => steps > 5000), compared.join());
});

/** Runs a copy of a machine beside one of rp2040js; returns how many steps were compared. */
function follow(pio, machine) {
  // Pins that change every few cycles: an encoder that runs and errs, pulses, noise.
  const changes = [];
  let levels = 0;
  for (let at = 0; at < 60_000; at += 1 + random(40)) {
    levels ^= 1 << random(30);
    changes.push([at, levels]);
  }
  const chip = new Chip(sleeper(), { levels: 0, fill() {} });
  const mine = chip.rp.pio[0].machines[machine.index];
  const rp = theirs();
  const their = rp.pio[0].machines[machine.index];
  load(mine, their, {
    instructions: [...pio.instructions],
    exec: machine.execCtrl, shift: machine.shiftCtrl, pins: machine.pinCtrl, pc: machine.pc, x: 2 ** 32 - 1, y: 2 ** 32 - 1,
    osr: machine.osr >>> 0,
  });
  let t = SYNC_CYCLES;
  let next = 0;
  let steps = 0;
  for (; t < 50_000; steps++) {
    // What is waited for is always there, so that neither stands still.
    const word = random(50);
    if (mine.txFIFO.empty) {
      mine.txFIFO.push(word);
      their.txFIFO.push(word);
    }
    while (next < changes.length && changes[next][0] <= t - SYNC_CYCLES) next++;
    const seen = next === 0 ? 0 : changes[next - 1][1];
    setLevels(rp, seen);
    chip.pins.clear(seen);
    mine.t = t % 1000 + 10;
    mine.k = 0;
    const from = mine.t;
    mine.run(from + 1, false);
    const before = their.cycles;
    const op = pio.instructions[their.pc];
    their.step();
    // OUT of all 32 bits empties OSR; rp2040js leaves them there.
    if ((op & 0xe01f) === 0x6000) their.outputShiftReg = 0;
    const what = `machine ${machine.index}, cycle ${t}`;
    assert.deepEqual(...look(mine, their), what);
    assert.equal(mine.t - from, their.cycles - before, `${what}: cycles`);
    while (!mine.rxFIFO.empty) {
      assert.equal(mine.rxFIFO.pull() >>> 0, their.rxFIFO.pull() >>> 0, what);
    }
    t += mine.t - from;
  }
  return steps;
}

test('turns that are left out leave the board as turns that are run', { skip: !image && 'no UMI_PICO_IMAGE' }, () => {
  // Rests of all lengths between motions and pulses: the loops begin and end anywhere.
  const [leaping, plodding] = [true, false].map((leaps) => {
    const board = new Board(segments(readFileSync(image)), Buffer.from('0123456789abcdef', 'hex'));
    board.chip.leaps = leaps;
    return board;
  });
  const both = [leaping, plodding];
  let moved = 0;
  for (let round = 0; round < 120; round++) {
    const cycles = round < 8 ? 5_000_000 : 1 + random(60_000);
    const axis = random(4);
    const motion = [{ edges: 1 + random(12), from: 13 + random(90), up: random(2) === 0 }];
    const pulse = { pin: 16 + random(2), at: [50 + random(5000)], width: 2 + random(400) };
    for (const board of both) {
      if (round >= 8 && round % 3 === 0) board.stimuli.startAxis(axis, { segments: motion });
      if (round >= 8 && round % 4 === 0) board.stimuli.startPulses(pulse);
      board.run(board.cycle + cycles);
    }
    moved += round >= 8 && round % 3 === 0 ? 1 : 0;
    const [a, b] = both.map(standing);
    assert.deepEqual(a, b, `round ${round}`);
    assert.ok(Buffer.from(leaping.chip.memory.buffer).equals(Buffer.from(plodding.chip.memory.buffer)), `round ${round}: memory`);
  }
  assert.ok(moved > 30 && leaping.chip.machines.filter((machine) => machine.loop !== null).length >= 7);
});

/** Where a board stands, down to its machines' registers. */
function standing(board) {
  const { chip } = board;
  chip.synchronise();
  return {
    cycle: board.cycle,
    registers: [...chip.rp.core.registers],
    resets: board.resets,
    machines: chip.machines.map(({ pc, x, y, isr, osr, inCount, outCount, t, stalled, rxFIFO, channel }) => ({
      pc, x, y, isr, osr, inCount, outCount, t: t + chip.base, stalled, rx: rxFIFO.itemCount,
      at: channel?.writeAddr, left: channel?.transCount,
    })),
  };
}

test('the UART takes and gives the same bytes, at the same rate', () => {
  for (let round = 0; round < 20; round++) {
    const board = new Board(sleeper(), Buffer.from('0123456789abcdef', 'hex'));
    const rp = new RP2040();
    rp.clkPeri = board.chip.rp.clkPeri;
    const given = [], took = [];
    board.control.onByte = (byte) => given.push(byte);
    rp.uart[0].onByte = (byte) => took.push(byte);
    const hasFifos = random(2);
    const settings = [[0x24, 1 + random(100)], [0x28, random(64)], [0x2c, 0x60 | hasFifos << 4], [0x30, 0x301]];
    for (const chip of [board.chip.rp, rp]) {
      for (const [register, value] of settings) chip.writeUint32(UART0 + register, value);
    }
    assert.ok(Math.abs(board.control.uart.baud - rp.uart[0].baudRate) <= 0.5);
    const character = Math.ceil(10 * board.control.uart.bitCycles);
    for (let i = 0; i < 40; i++) {
      const [out, back] = [random(256), random(256)];
      board.chip.rp.writeUint32(UART0, out);
      rp.writeUint32(UART0, out);
      board.control.send([back]);
      rp.uart[0].feedByte(back);
      board.run(board.cycle + 2 * character + 10);
      assert.equal(board.chip.rp.readUint32(UART0) & 0xff, rp.readUint32(UART0));
      const empty = [board.chip.rp, rp].map((chip) => chip.readUint32(UART0 + 0x18) & (1 << 4));
      assert.deepEqual(empty, [1 << 4, 1 << 4]);
    }
    assert.deepEqual(given, took);
  }
});

test('a line that is looped back hears itself, and not the control', () => {
  const board = new Board(sleeper(), Buffer.alloc(8));
  const { chip, control } = board;
  const { uart } = control;
  const [DR, FR, IBRD, LCR_H, CR] = [0x00, 0x18, 0x24, 0x2c, 0x30];
  uart.writeUint32(IBRD, 68);
  uart.writeUint32(LCR_H, 0x60);
  uart.writeUint32(CR, 0x381);
  uart.writeUint32(DR, 0x5a);
  control.send(Buffer.from('c'));
  board.run(20 * 68 * 16);
  assert.equal(uart.readUint32(FR) & 0x10, 0, 'it has come');
  assert.equal(uart.readUint32(DR), 0x5a);
  assert.deepEqual([control.heard, control.unheard], [0, 1]);
  uart.writeUint32(CR, 0x301);
  uart.writeUint32(DR, 0x5b);
  board.run(board.cycle + 20 * 68 * 16);
  assert.deepEqual([control.heard, uart.readUint32(FR) & 0x10], [1, 0x10]);
  assert.ok(chip.cycle > 0);
});

test('what the line brings asks the DMA for each character, with its errors above it', () => {
  const board = new Board(sleeper(), Buffer.alloc(8));
  const { chip, control } = board;
  const { uart } = control;
  const { dma } = chip.rp;
  const [IBRD, LCR_H, CR, DMACR] = [0x24, 0x2c, 0x30, 0x48];
  const RAM = 0x20001000, HALFWORD = 1 << 2, RING_OF_8 = 1 << 10 | 3 << 6;
  uart.writeUint32(IBRD, 68);
  uart.writeUint32(LCR_H, 0x60);
  uart.writeUint32(CR, 0x301);
  uart.writeUint32(DMACR, 1);
  dma.writeUint32(0x404, 0b11);
  // Two channels that start each other, one transfer each.
  for (const [channel, other] of [[1, 0], [0, 1]]) {
    dma.writeUint32(0x40 * channel, UART0);
    dma.writeUint32(0x40 * channel + 4, RAM + 8 * channel);
    dma.writeUint32(0x40 * channel + 8, 1);
    const control = 21 << 15 | other << 11 | RING_OF_8 | 1 << 5 | HALFWORD | 1;
    dma.writeUint32(0x40 * channel + (channel === 0 ? 0x0c : 0x10), control);
  }
  control.send(Buffer.from('abcdefghij'));
  board.run(5 * 160 * 68);
  const words = () => [0, 4, 8, 12].flatMap((at) => {
    const word = chip.core.read32(RAM + at) >>> 0;
    return [word & 0xffff, word >>> 16];
  });
  assert.deepEqual(words().slice(0, 2), [0x61, 0x63]);
  assert.deepEqual(words().slice(4, 6), [0x62, 0x64]);
  assert.equal(dma.readUint32(0x40c) & 0b11, 0b11, 'each asks for an interrupt');
  board.run(board.cycle + 6 * 160 * 68);
  // The ring of the first begins again with i, that of the second with j.
  assert.deepEqual(words(), [0x69, 0x63, 0x65, 0x67, 0x6a, 0x64, 0x66, 0x68]);
  assert.equal(control.overruns, 0);
  // Without the bus the next is kept, and the one behind it lost, which is told above it.
  chip.holdTransfers(10 * 160 * 68);
  control.send(Buffer.from('klm'));
  board.run(board.cycle + 15 * 160 * 68);
  assert.deepEqual(words()[1], 0x86b);
  assert.equal(control.overruns, 2);
});
