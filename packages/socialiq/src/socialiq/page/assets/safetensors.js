// Files of arrays with one JSON header (safetensors), as `socialiq.storage` reads and writes them.

import { sha256 } from "./sha256.js";

const KINDS = {
  F32: [Float32Array, "<f4"], F64: [Float64Array, "<f8"], I64: [BigInt64Array, "<i8"],
  I32: [Int32Array, "<i4"], I8: [Int8Array, "|i1"], BOOL: [Uint8Array, "|b1"],
}; // of an array in the file: its class here, and its name in NumPy

/** A mistake of the person at the page, said in one line. */
export class UserError extends Error {}

/** Return `{ header, arrays }` of a file's bytes; each array is `{ shape, values }`. */
export function readArrays(bytes) {
  let listed;
  let first;
  try {
    const length = Number(new DataView(bytes.buffer, bytes.byteOffset).getBigUint64(0, true));
    listed = JSON.parse(new TextDecoder().decode(bytes.subarray(8, 8 + length)));
    first = 8 + length;
    const { header } = JSON.parse(listed.__metadata__.socialiq);
    const arrays = {};
    for (const [name, one] of Object.entries(listed)) {
      if (name !== "__metadata__") arrays[name] = arrayOf(bytes, first, one);
    }
    return { header, arrays };
  } catch {
    throw new UserError("this is no file of socialiq, or it is damaged: choose another one");
  }
}

function arrayOf(bytes, first, { dtype, shape, data_offsets: [begin, end] }) {
  const [Kind] = KINDS[dtype];
  const values = new Kind(bytes.slice(first + begin, first + end).buffer);
  if (values.length !== shape.reduce((product, length) => product * length, 1)) throw new Error();
  return { shape, values };
}

/**
 * Return the bytes of a file.
 *
 * @param {string} kind Kind of content, such as "demonstrations".
 * @param {number} version Version of its schema.
 * @param {Object<string, {dtype: string, shape: number[], values: object}>} arrays Typed arrays.
 * @param {object} header JSON-compatible.
 */
export function writeArrays(kind, version, arrays, header) {
  const full = { kind, version, ...header };
  const names = Object.keys(arrays).sort();
  const text = canonical({ header: full, sha256: contentHash(arrays, names, full) });
  const listed = { __metadata__: { socialiq: text } };
  let end = 0;
  for (const name of names) {
    const { dtype, shape, values } = arrays[name];
    listed[name] = { dtype, shape, data_offsets: [end, (end += values.byteLength)] };
  }
  const head = new TextEncoder().encode(JSON.stringify(listed));
  const padded = Math.ceil(head.length / 8) * 8;
  const file = new Uint8Array(8 + padded + end).fill(0x20, 8, 8 + padded);
  new DataView(file.buffer).setBigUint64(0, BigInt(padded), true);
  file.set(head, 8);
  let at = 8 + padded;
  for (const name of names) {
    const { values } = arrays[name];
    file.set(new Uint8Array(values.buffer, values.byteOffset, values.byteLength), at);
    at += values.byteLength;
  }
  return file;
}

/** The hash of `socialiq.storage.content_hash`: the header, then each array by name. */
function contentHash(arrays, names, header) {
  const parts = [new TextEncoder().encode(canonical(header))];
  for (const name of names) {
    const { dtype, shape, values } = arrays[name];
    const lengths = shape.length === 1 ? `${shape[0]},` : shape.join(", ");
    parts.push(new TextEncoder().encode(`${name}:${KINDS[dtype][1]}:(${lengths})`));
    parts.push(new Uint8Array(values.buffer, values.byteOffset, values.byteLength));
  }
  return sha256(parts);
}

/** JSON with sorted keys, as Python's `json.dumps(..., sort_keys=True)` writes it. */
export function canonical(value) {
  if (Array.isArray(value)) return `[${value.map(canonical).join(", ")}]`;
  if (value !== null && typeof value === "object") {
    const parts = Object.keys(value).sort().map((key) => `${ascii(key)}: ${canonical(value[key])}`);
    return `{${parts.join(", ")}}`;
  }
  return typeof value === "string" ? ascii(value) : JSON.stringify(value);
}

function ascii(text) {
  const code = (letter) => `\\u${letter.charCodeAt(0).toString(16).padStart(4, "0")}`;
  return JSON.stringify(text).replace(/[\u007f-\uffff]/g, code);
}
