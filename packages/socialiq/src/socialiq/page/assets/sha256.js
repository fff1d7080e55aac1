// SHA-256 (FIPS 180-4); the browser's own is refused to pages that are opened from a folder.

const FIRST = [2, 3, 5, 7, 11, 13, 17, 19];
const word = (value) => ((value - Math.floor(value)) * 2 ** 32) >>> 0;
const primes = [];
for (let one = 2; primes.length < 64; one += 1) if (primes.every((prime) => one % prime)) primes.push(one);
const ROUNDS = primes.map((prime) => word(Math.cbrt(prime)));

const right = (value, by) => (value >>> by) | (value << (32 - by));

/** Return the hash of the parts, one after another, in hexadecimal digits. */
export function sha256(parts) {
  const length = parts.reduce((sum, part) => sum + part.length, 0);
  const message = new Uint8Array(Math.ceil((length + 9) / 64) * 64);
  let at = 0;
  for (const part of parts) {
    message.set(part, at);
    at += part.length;
  }
  message[length] = 0x80;
  const view = new DataView(message.buffer);
  view.setBigUint64(message.length - 8, BigInt(length) * 8n);
  const state = FIRST.map((prime) => word(Math.sqrt(prime)));
  const words = new Uint32Array(64);
  for (let block = 0; block < message.length; block += 64) {
    for (let place = 0; place < 16; place += 1) words[place] = view.getUint32(block + 4 * place);
    mix(state, words);
  }
  return state.map((one) => one.toString(16).padStart(8, "0")).join("");
}

function mix(state, words) {
  for (let place = 16; place < 64; place += 1) {
    const before = words[place - 15];
    const last = words[place - 2];
    const low = right(before, 7) ^ right(before, 18) ^ (before >>> 3);
    const high = right(last, 17) ^ right(last, 19) ^ (last >>> 10);
    words[place] = words[place - 16] + low + words[place - 7] + high;
  }
  let [a, b, c, d, e, f, g, h] = state;
  for (let place = 0; place < 64; place += 1) {
    const one = h + (right(e, 6) ^ right(e, 11) ^ right(e, 25)) + ((e & f) ^ (~e & g)) + ROUNDS[place] + words[place];
    const two = (right(a, 2) ^ right(a, 13) ^ right(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
    [h, g, f, e, d, c, b, a] = [g, f, e, (d + one) >>> 0, c, b, a, (one + two) >>> 0];
  }
  [a, b, c, d, e, f, g, h].forEach((value, place) => (state[place] = (state[place] + value) >>> 0));
}
