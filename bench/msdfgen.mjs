// Multi-channel distance fields by msdfgen (V. Chlumsky), through its Node binding @circuitly/msdfgen.
//
// Reads {"module": path, "polygons": [[x, y, ...], ...], "fields": [{"width", "height", "scale", "range", "translate"}]} from
// standard input, y upward, fields as the binding takes them: scale is texels per unit, range and translate are units.
// Writes {"fields": [base64 of width * height * 4 bytes, row 0 at the bottom]}: MSDF in three channels, true distance in
// the fourth.
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";

const request = JSON.parse(readFileSync(0, "utf8"));
const { generateMTSDF } = createRequire(import.meta.url)(request.module);

const contours = request.polygons.map((flat) => {
  const points = [];
  for (let i = 0; i < flat.length; i += 2) points.push({ x: flat[i], y: flat[i + 1] });
  const edges = points.map((point, i) => ({ type: "linear", points: [point, points[(i + 1) % points.length]] }));
  return { edges };
});
const fields = request.fields.map((field) => generateMTSDF({ contours }, field).toString("base64"));
process.stdout.write(JSON.stringify({ fields }));
