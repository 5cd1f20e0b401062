// Binary messages of the bridge by their first four bytes, and slices, which only it and the page know.

import { KINDS, RECORDS, SLICE_MAGIC } from "./layout.mjs";
import { readRecord } from "./decaff.mjs";

export const MAGIC_OF_GLB = 0x46546c67;
const NAME_OF = new Map(Object.entries(KINDS).map(([name, kind]) => [kind.magic, name]));

/** What a message is by its first four bytes: the name of a kind, "glb", "slice", or "" for none. */
export function kindOf(buffer) {
  if (buffer.byteLength < 4) return "";
  const magic = new DataView(buffer).getUint32(0, true);
  if (magic === MAGIC_OF_GLB) return "glb";
  return magic === SLICE_MAGIC ? "slice" : (NAME_OF.get(magic) ?? "");
}

/** Read a slice of the signed distance: where it is, and its numbers row by row. */
export function decodeSlice(buffer) {
  const layout = RECORDS.slice_header;
  const head = readRecord(new DataView(buffer), 0, layout);
  return { ...head, values: new Float32Array(buffer, layout.size) };
}
