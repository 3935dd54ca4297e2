// three.js' LightProbeGenerator on the faces of a file: node light_probe.mjs FILE SIZE. Prints JSON.
import { readFileSync } from "node:fs";
import { FloatType, NoColorSpace, WebGLCoordinateSystem } from "three";
import { LightProbeGenerator } from "three/examples/jsm/lights/LightProbeGenerator.js";

const [path, size] = [process.argv[2], Number(process.argv[3])];
const file = readFileSync(path);
const faces = new Float32Array(file.buffer, file.byteOffset, file.length / 4);
const target = { width: size, texture: { type: FloatType, colorSpace: NoColorSpace } };
const renderer = {
  isWebGLRenderer: true,
  coordinateSystem: WebGLCoordinateSystem,
  async readRenderTargetPixelsAsync(_, x, y, width, height, data, face) {
    data.set(faces.subarray(face * 4 * size * size, (face + 1) * 4 * size * size));
  },
};
const seconds = [];
let probe;
for (let k = 0; k < 7; ++k) {
  const begin = performance.now();
  probe = await LightProbeGenerator.fromCubeRenderTarget(renderer, target);
  if (k > 1) seconds.push((performance.now() - begin) / 1000);  // compiled by then
}
console.log(JSON.stringify({ sh: probe.sh.coefficients.map((v) => v.toArray()), seconds }));
