// The flash's cache: lines, ways, and which of them goes.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Cache, CacheControl, LINE_CYCLES, WORD_CYCLES } from './cache.js';

const FLASH = 0x10000000;
/** So far apart two addresses share a set. */
const WAY = 8192;

/** Where a miss brings both words of its line. */
function byLines() {
  const cache = new Cache();
  cache.byWords(false);
  return cache;
}

test('a line of eight bytes costs once', () => {
  const cache = byLines();
  assert.equal(LINE_CYCLES, 56);
  for (const [address, cycles] of [[0, 56], [7, 0], [4, 0], [8, 56], [15, 0], [0, 0]]) {
    assert.equal(cache.read(FLASH + address), cycles, address);
  }
  assert.deepEqual(cache.takeCounts(), { hits: 4, misses: 2 });
  assert.deepEqual(cache.takeCounts(), { hits: 0, misses: 0 });
  assert.deepEqual(cache.total, { hits: 4, misses: 2 });
  cache.flush();
  assert.equal(cache.read(FLASH), LINE_CYCLES);
});

test('words that come one by one cost each, and go with their line', () => {
  const cache = new Cache();
  assert.equal(WORD_CYCLES, 44);
  for (const [address, cycles] of [[0, 44], [3, 0], [4, 44], [7, 0], [0, 0], [12, 44], [8, 44]]) {
    assert.equal(cache.read(FLASH + address), cycles, address);
  }
  // Two others in its set: both words of the first are gone.
  for (const way of [1, 2]) assert.equal(cache.read(FLASH + way * WAY), 44);
  assert.deepEqual([0, 4, 0].map((at) => cache.read(FLASH + at)), [44, 44, 0]);
  assert.equal(cache.fetch(FLASH + 4), 0);
  assert.equal(cache.latest, (FLASH + 4) >>> 2);
  cache.byWords(false);
  assert.equal(cache.read(FLASH), 56);
});

test('of three lines for two ways the one used longest ago goes', () => {
  const cache = byLines();
  const [a, b, c] = [FLASH + 24, FLASH + 24 + WAY, FLASH + 24 + 5 * WAY];
  const costs = [a, b, a, c, a, b, a, c].map((address) => cache.read(address));
  assert.deepEqual(costs, [56, 56, 0, 56, 0, 56, 0, 56]);
});

test('all of 16 KB in a row stays, and one line more takes the place of the first', () => {
  const cache = byLines();
  for (let at = 0; at < 16384; at += 8) assert.equal(cache.fetch(FLASH + at), 56);
  for (let at = 0; at < 16384; at += 8) assert.equal(cache.fetch(FLASH + at), 0);
  assert.equal(cache.fetch(FLASH + 16384), 56);
  assert.equal(cache.fetch(FLASH), 56);
});

test('a constant that takes the place of the running code makes it come again', () => {
  const cache = byLines();
  cache.fetch(FLASH);
  assert.equal(cache.latest, FLASH >>> 3);
  cache.read(FLASH + 8);
  assert.equal(cache.latest, FLASH >>> 3, 'another set');
  cache.read(FLASH + WAY);
  assert.equal(cache.latest, -1);
  cache.read(FLASH + 2 * WAY);
  assert.equal(cache.fetch(FLASH), 56);
});

test('the program counts, flushes and clears by XIP_CTRL', () => {
  const core = { cache: byLines() };
  const control = new CacheControl({ rp: {}, core });
  const [FLUSH, STAT, HIT, ACCESSES] = [0x04, 0x08, 0x0c, 0x10];
  for (let at = 0; at < 80; at += 4) core.cache.read(FLASH + at);
  assert.deepEqual([HIT, ACCESSES].map((at) => control.readUint32(at)), [10, 20]);
  control.writeUint32(HIT, 0);
  control.writeUint32(ACCESSES, 0);
  core.cache.read(FLASH);
  assert.deepEqual([HIT, ACCESSES].map((at) => control.readUint32(at)), [1, 1]);
  control.writeUint32(FLUSH, 1);
  assert.equal(control.readUint32(STAT) & 1, 1);
  assert.equal(core.cache.read(FLASH), LINE_CYCLES);
  assert.deepEqual([HIT, ACCESSES].map((at) => control.readUint32(at)), [1, 2]);
});
