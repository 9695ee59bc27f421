// The program: what it says when it cannot start, and when a request is wrong. Run by `node --test`.

import assert from 'node:assert/strict';
import { spawn, spawnSync } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { connect } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';

const MAIN = new URL('main.js', import.meta.url).pathname;

/** An ELF file with one segment. */
function elf(address, size) {
  const file = Buffer.alloc(84 + size);
  file.writeUInt32BE(0x7f454c46, 0);
  file[4] = 1;
  file.writeUInt32LE(52, 28);
  file.writeUInt16LE(32, 42);
  file.writeUInt16LE(1, 44);
  for (const [at, value] of [[52, 1], [56, 84], [64, address], [68, size], [72, size]]) {
    file.writeUInt32LE(value, at);
  }
  return file;
}

test('what cannot start says why, in one line', () => {
  const folder = mkdtempSync(join(tmpdir(), 'umi-rp2040-'));
  const file = (name, bytes) => {
    writeFileSync(join(folder, name), bytes);
    return join(folder, name);
  };
  for (const [args, says] of [
    [[], /^usage: /],
    [['--fast'], /no option --fast/],
    [[join(folder, 'none.elf')], /cannot be read: ENOENT/],
    [[file('text.elf', 'no image')], /is no image for this board: .*ELF/],
    [[file('other.elf', elf(0x60000000, 16))], /is no image for this board: .*outside the flash/],
    [['--unique-id', '12', file('short.elf', elf(0x10000100, 192))], /16 hexadecimal digits/],
  ]) {
    const { status, stderr } = spawnSync(process.execPath, [MAIN, ...args], { encoding: 'utf8' });
    assert.equal(status, 2, args.join(' '));
    assert.match(stderr, says);
    assert.equal(stderr.trim().split('\n').length, 1, stderr);
  }
  rmSync(folder, { recursive: true });
});

test('a wrong request is answered by its error', async () => {
  const folder = mkdtempSync(join(tmpdir(), 'umi-rp2040-'));
  const image = join(folder, 'empty.elf');
  writeFileSync(image, elf(0x10000100, 192));
  const process_ = spawn(process.execPath, [MAIN, image, '--paused']);
  const { bench } = JSON.parse((await once(process_.stdout, 'data')).toString());
  const socket = connect(bench, '127.0.0.1');
  const ask = async (request) => {
    socket.write(`${JSON.stringify(request)}\n`);
    return JSON.parse((await once(socket, 'data')).toString());
  };
  assert.deepEqual(await ask({ do: 'axis', axis: 9, segments: [{ rest: 1 }] }), {
    error: 'there is no axis 9: they are 0 to 3',
  });
  assert.deepEqual(await ask({ do: 'dance' }), { error: 'no request is called dance' });
  assert.equal((await ask({ do: 'state' })).is_on, true);
  socket.destroy();
  process_.stdin.end();
  await once(process_, 'exit');
  rmSync(folder, { recursive: true });
});
