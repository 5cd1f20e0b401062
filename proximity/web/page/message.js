// Messages as the service has them, byte for byte: read from and written into an ArrayBuffer.
//
// Whole numbers of 64 bits are BigInt. A field of several numbers is an array, row by row.

import { CHECKED_FROM, KINDS, RECORDS, SLICE_MAGIC, VERSION } from "./layout.js";

export const MAGIC_OF_GLB = 0x46546c67;
const NAME_OF = new Map(Object.entries(KINDS).map(([name, kind]) => [kind.magic, name]));
const utf8 = new TextEncoder();
const text = new TextDecoder();

const CRC_TABLE = new Uint32Array(256).map((_, byte) => {
  let crc = byte;
  for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  return crc;
});

/** The CRC-32 of bytes, as zlib has it. */
export function crc32(bytes) {
  let crc = 0xffffffff;
  for (let i = 0; i < bytes.length; i++) crc = (crc >>> 8) ^ CRC_TABLE[(crc ^ bytes[i]) & 0xff];
  return (crc ^ 0xffffffff) >>> 0;
}

/** What a message is by its first four bytes: the name of a kind, "glb", "slice", or "" for none. */
export function kindOf(buffer) {
  if (buffer.byteLength < 4) return "";
  const magic = new DataView(buffer).getUint32(0, true);
  if (magic === MAGIC_OF_GLB) return "glb";
  return magic === SLICE_MAGIC ? "slice" : (NAME_OF.get(magic) ?? "");
}

/** Read one record of a layout. */
export function readRecord(view, offset, record) {
  const values = {};
  for (const [name, field] of Object.entries(record.fields)) values[name] = readField(view, offset, field);
  return values;
}

/** Read one field: a number, an array of numbers, or text. */
export function readField(view, offset, field) {
  const start = offset + field.offset;
  if (field.type === "Text") {
    const bytes = new Uint8Array(view.buffer, view.byteOffset + start, field.count);
    const end = bytes.indexOf(0);
    return text.decode(end < 0 ? bytes : bytes.subarray(0, end));
  }
  const get = `get${field.type}`;
  if (field.count === 1) return view[get](start, true);
  return Array.from({ length: field.count }, (_, k) => view[get](start + k * field.size, true));
}

function writeField(view, offset, field, value) {
  const start = offset + field.offset;
  if (field.type === "Text") {
    new Uint8Array(view.buffer, start, field.count).set(utf8.encode(value).subarray(0, field.count));
    return;
  }
  const set = `set${field.type}`;
  if (field.count === 1 && !Array.isArray(value)) return void view[set](start, value, true);
  for (let k = 0; k < field.count; k++) view[set](start + k * field.size, value[k], true);
}

/** Read a whole message: its kind, header and records. */
export function decode(buffer) {
  const kind = kindOf(buffer);
  const { header, record } = KINDS[kind];
  const view = new DataView(buffer);
  const head = readRecord(view, 0, RECORDS[header]);
  const records = [];
  for (let k = 0; k < head.count; k++) {
    records.push(readRecord(view, RECORDS[header].size + k * RECORDS[record].size, RECORDS[record]));
  }
  return { kind, header: head, records };
}

/** Write a whole message with its checksum; session and sequence are the bridge's to fill in. */
export function encode(kind, header, records) {
  const { magic, header: headerName, record: recordName } = KINDS[kind];
  const [head, record] = [RECORDS[headerName], RECORDS[recordName]];
  const buffer = new ArrayBuffer(head.size + records.length * record.size);
  const view = new DataView(buffer);
  const known = { magic, version: VERSION, header_size: head.size, size: buffer.byteLength, count: records.length };
  for (const [name, value] of Object.entries({ ...known, ...header })) {
    writeField(view, 0, head.fields[name], value);
  }
  records.forEach((values, k) => {
    for (const [name, value] of Object.entries(values)) {
      writeField(view, head.size + k * record.size, record.fields[name], value);
    }
  });
  view.setUint32(head.fields.checksum.offset, crc32(new Uint8Array(buffer, CHECKED_FROM)), true);
  return buffer;
}

/** Read a slice of the signed distance: where it is, and its numbers row by row. */
export function decodeSlice(buffer) {
  const layout = RECORDS.slice_header;
  const head = readRecord(new DataView(buffer), 0, layout);
  return { ...head, values: new Float32Array(buffer, layout.size) };
}
