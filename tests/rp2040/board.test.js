// The parts around the core, each by itself. Run by `node --test`.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Board } from './board.js';
import { Nor } from './nor.js';
import { Stimuli } from './stimuli.js';

const PIO0 = 0x50200000, UART0 = 0x40034000;

/** A board whose core sleeps for ever. */
function board() {
  const words = new Uint32Array(48);
  words[0] = 0x20040000;
  words[1] = 0x10000181;
  const code = Uint16Array.of(0xbf20, 0xbf20, 0xe7fc); // wfe, wfe, b
  const bytes = new Uint8Array(256);
  bytes.set(new Uint8Array(words.buffer), 0);
  bytes.set(new Uint8Array(code.buffer), 0x80);
  const it = new Board([{ address: 0x10000100, bytes }], Buffer.from('0123456789abcdef', 'hex'));
  it.run(100);
  return it;
}

test('a machine sees an input two cycles after its edge, each cycle once, and stalls when full', () => {
  const it = board();
  const { rp } = it.chip;
  rp.writeUint32(PIO0 + 0x48, 0x4001); // in pins, 1
  rp.writeUint32(PIO0 + 0xcc, 0); // wraps onto itself
  rp.writeUint32(PIO0 + 0xd0, (1 << 31) | (1 << 16)); // RX joined, autopush, shift left
  rp.writeUint32(PIO0 + 0xdc, 16 << 15);
  const at = it.stimuli.startPulses({ pin: 16, at: [40], width: 8 }) + 40;
  it.run(at - 60);
  const begun = it.cycle + 1;
  rp.writeUint32(PIO0, 1);
  it.run(it.cycle + 400);
  assert.equal(rp.readUint32(PIO0 + 8) & 1, 1, 'RXSTALL');
  const bits = [];
  for (let i = 0; i < 8; i++) {
    const word = rp.readUint32(PIO0 + 0x20);
    for (let bit = 31; bit >= 0; bit--) bits.push((word >>> bit) & 1);
  }
  const seen = bits.map((bit, i) => (bit ? begun + i : 0)).filter((cycle) => cycle > 0);
  assert.deepEqual(seen, Array.from({ length: 8 }, (_, i) => at + 2 + i));
});

test('an abort reads as done before it is, and starts again what was enabled or chained', () => {
  const it = board();
  const { rp } = it.chip;
  const DMA = 0x50000000, AL1_CTRL = 0x10, TRIG = 0x0c, ABORT = 0x444, EN = 1, BUSY = 1 << 24;
  const control = (chainTo) => EN | (2 << 2) | (chainTo << 11) | (4 << 15); // of PIO 0, which sends nothing
  const busy = (channel) => (rp.readUint32(DMA + 0x40 * channel + TRIG) & BUSY) !== 0;
  const start = () => {
    for (const channel of [0, 1]) rp.writeUint32(DMA + 0x40 * channel + 8, 100);
    rp.writeUint32(DMA + 0x40 + AL1_CTRL, control(0));
    rp.writeUint32(DMA + TRIG, control(1));
    assert.deepEqual([busy(0), busy(1)], [true, false]);
  };
  const abort = () => {
    rp.writeUint32(DMA + ABORT, 0b11);
    assert.equal(rp.readUint32(DMA + ABORT), 0);
    assert.ok(busy(0), 'transfers are on their way');
    it.run(it.cycle + 100);
  };
  start();
  abort();
  assert.deepEqual([busy(0), busy(1)], [true, true], 'both go on');
  assert.deepEqual(it.chip.aborts, { asked: 1, again: 2, early: 0 }, 'and are counted');
  // Switched off, and chained to itself, each ends.
  for (let turn = 0; turn < 2; turn++) {
    for (const channel of [0, 1]) rp.writeUint32(DMA + 0x40 * channel + AL1_CTRL, control(channel) & ~EN);
    abort();
    assert.deepEqual([busy(0), busy(1)], [false, false]);
    start();
  }
  const { asked, again } = it.chip.aborts;
  assert.ok(asked > 1);
  assert.equal(again, 2, 'of the first alone');
  // Started before it is over, it is ended with the transfers before it.
  for (const channel of [0, 1]) rp.writeUint32(DMA + 0x40 * channel + AL1_CTRL, control(channel) & ~EN);
  rp.writeUint32(DMA + ABORT, 0b11);
  rp.writeUint32(DMA + TRIG, control(0));
  assert.equal(it.chip.aborts.early, 1);
  it.run(it.cycle + 100);
  assert.equal(busy(0), false);
});

test('delays and dividers take their time', () => {
  const it = board();
  const { rp } = it.chip;
  rp.writeUint32(PIO0 + 0x48, 0xe001 | (3 << 8)); // set pins, 1 [3]
  rp.writeUint32(PIO0 + 0x4c, 0xe000); // set pins, 0
  rp.writeUint32(PIO0 + 0xcc, 1 << 12);
  rp.writeUint32(PIO0 + 0xc8, 5 << 16);
  rp.writeUint32(PIO0 + 0xdc, (1 << 26) | (22 << 5));
  rp.writeUint32(0x40014000 + 22 * 8 + 4, 6);
  rp.writeUint32(PIO0 + 0xd8, 0xe081); // set pindirs, 1
  rp.writeUint32(PIO0, 1);
  it.run(it.cycle + 200);
  const times = it.outputs.filter(([pin]) => pin === 22).map(([, , cycle]) => cycle);
  const steps = times.slice(2).map((cycle, i) => cycle - times[i + 1]);
  assert.deepEqual(steps.slice(0, 4), steps[0] === 20 ? [20, 5, 20, 5] : [5, 20, 5, 20]);
});

test('a pulse of the chip interrupts when another machine has seen it, whoever looks', () => {
  const it = board();
  const { rp } = it.chip;
  const INTE = 0x12c, SM1 = 0x18;
  rp.writeUint32(PIO0 + 0x48, 0xf001 | (31 << 8)); // set pins, 1 [31]
  rp.writeUint32(PIO0 + 0x4c, 0xf000 | (31 << 8)); // set pins, 0 [31]
  rp.writeUint32(PIO0 + 0x50, 0x20a0); // wait 1 pin, 0
  rp.writeUint32(PIO0 + 0x54, 0x8000); // push noblock
  rp.writeUint32(PIO0 + 0x58, 0x2020); // wait 0 pin, 0
  rp.writeUint32(PIO0 + 0xc8, 20 << 16); // an edge each 640 cycles
  rp.writeUint32(PIO0 + 0xcc, 1 << 12);
  rp.writeUint32(PIO0 + 0xdc, (1 << 26) | (22 << 5));
  rp.writeUint32(PIO0 + 0xcc + SM1, (4 << 12) | (2 << 7));
  rp.writeUint32(PIO0 + 0xdc + SM1, 22 << 15);
  rp.writeUint32(PIO0 + 0xd8 + SM1, 0x0002); // jmp 2
  rp.writeUint32(0x40014000 + 22 * 8 + 4, 6);
  rp.writeUint32(PIO0 + 0xd8, 0xe081); // set pindirs, 1
  rp.writeUint32(PIO0 + INTE, 2);
  rp.writeUint32(PIO0, 3);
  const { setInterrupt } = rp.core;
  let asked = null;
  rp.core.setInterrupt = (irq, value) => {
    if (irq === 7 && value) asked ??= it.cycle;
    setInterrupt(irq, value);
  };
  it.run(it.cycle + 3000);
  const [, , rise] = it.outputs.find(([pin, level]) => pin === 22 && level);
  assert.ok(asked > rise && asked < rise + 16, `${asked}, risen at ${rise}`);
});

test('without its FIFO the receiver holds one character, and tells what it lost', () => {
  const it = board();
  const { rp } = it.chip;
  rp.writeUint32(UART0 + 0x24, 67);
  rp.writeUint32(UART0 + 0x28, 52);
  rp.writeUint32(UART0 + 0x2c, 0x60); // 8 bits, no FIFO
  rp.writeUint32(UART0 + 0x30, 0x301);
  it.control.send([1, 2, 3]);
  const begun = it.cycle;
  it.run(begun + 4 * 10 * 1085);
  assert.equal(rp.readUint32(UART0), 1 | (1 << 11), 'what was lost came behind it');
  assert.equal(it.control.overruns, 2);
  assert.notEqual(rp.readUint32(UART0 + 0x3c) & (1 << 10), 0, 'OERIS');
  it.control.send([4]);
  it.run(it.cycle + 11 * 1085);
  assert.equal(rp.readUint32(UART0), 4, 'once');
  // One in the shifter, one behind it, and no more.
  for (const byte of [5, 6]) rp.writeUint32(UART0, byte);
  assert.notEqual(rp.readUint32(UART0 + 0x18) & (1 << 5), 0, 'TXFF');
  const sent = it.cycle;
  it.run(sent + 21 * 1085);
  const [first, second] = it.control.stamps.slice(-2);
  assert.ok(Math.abs(first - sent - 10852) < 3 && Math.abs(second - first - 10852) < 3);
});

test('the flash programs by clearing bits, wraps in its page, and is cut in the middle', () => {
  const it = board();
  const { nor } = it;
  const command = (...bytes) => {
    nor.select(true);
    const answer = bytes.map((byte) => nor.exchange(byte));
    nor.select(false);
    return answer;
  };
  command(0x02, 0, 0, 0, 0);
  assert.equal(nor.data[0], 0xff, 'not enabled');
  command(0x06);
  command(0x02, 0, 1, 0xfe, 0xf0, 0x0f, 0xaa);
  assert.equal(command(0x05, 0)[1], 3, 'busy');
  assert.equal(command(0x03, 0, 1, 0xfe, 0)[4], 0xff, 'nothing else while busy');
  it.run(it.cycle + 125 * 100);
  assert.deepEqual([...nor.data.slice(0x1fe, 0x200), nor.data[0x100]], [0xf0, 0x0f, 0xaa]);
  command(0x06);
  command(0x02, 0, 1, 0xfe, 0x3f);
  it.run(it.cycle + 125 * 100);
  assert.equal(command(0x0b, 0, 1, 0xfe, 0, 0)[5], 0x30);
  command(0x06);
  command(0x20, 0, 1, 0);
  it.run(it.cycle + 125 * 46_000);
  assert.equal(nor.data[0x1fe], 0xff);
  assert.deepEqual(command(0x9f, 0, 0, 0).slice(1), [0xef, 0x40, 0x18]);
  assert.equal(Buffer.from(command(0x4b, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0).slice(5)).toString('hex'), '0123456789abcdef');
  nor.cutAfter = 2;
  command(0x06);
  command(0x02, 0, 3, 0, 1, 2, 3, 4);
  it.run(it.cycle + 125 * 100);
  assert.equal(it.isOn, false);
  assert.deepEqual([...nor.data.slice(0x300, 0x302), nor.data[0x303]], [1, 2, 0xff]);
  assert.equal(nor.data[0x302] & 3, 3, 'half done: bits may be set still');
});

test('an erase that is cut short leaves neither', () => {
  const it = board();
  const { nor } = it;
  nor.data.fill(0, 0, 4096);
  for (const bytes of [[0x06], [0x20, 0, 0, 0]]) {
    nor.select(true);
    for (const byte of bytes) nor.exchange(byte);
    nor.select(false);
  }
  it.run(it.cycle + 1000);
  it.powerOff();
  const values = new Set(nor.data.slice(0, 4096));
  assert.ok(values.size > 10);
  it.powerOn();
  assert.ok(it.isOn && it.nor instanceof Nor);
});

test('the truth about an axis at an edge', () => {
  const stimuli = new Stimuli([8, 10, 12, 14]);
  const edges = [];
  const pins = { note: (cycle, levels) => edges.push([cycle, levels]) };
  stimuli.startAxis(1, { segments: [{ edges: 6, from: 10 }, { rest: 5 }, { edges: 4, from: 10, up: false }] });
  stimuli.startPulses({ pin: 16, at: [35, 60, 95], width: 2, record: true });
  stimuli.fill(0, pins);
  const rows = [];
  for (let i = 0; i < stimuli.truth.length; i += 14) {
    const [pin, cycle] = stimuli.truth.slice(i, i + 2);
    rows.push([pin, cycle, ...stimuli.truth.slice(i + 5, i + 8)]);
  }
  assert.deepEqual(rows, [
    [16, 35, 3, 5, 5],
    [16, 60, 6, 0, 15],
    [16, 95, 3, 0, 10],
  ]);
  assert.equal(stimuli.axes[1].position, 2);
  // B follows A when it counts up.
  assert.deepEqual(edges.slice(1, 3), [
    [10, 1 << 10],
    [20, 3 << 10],
  ]);
});
