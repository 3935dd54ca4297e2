// Loads light exported by fastibl as three.js objects.
import * as THREE from "three";
import { decodeHdr } from "./decode.js";

async function strip(url) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url}: ${answer.status}`);
  return decodeHdr(await answer.arrayBuffer());
}

// Half floats reach up to 65504: brighter texels are cut off there.
function half({ width, height, data }) {
  const out = new Uint16Array((data.length / 3) * 4);
  for (let i = 0; i < width * height; ++i) {
    for (let c = 0; c < 3; ++c) out[4 * i + c] = THREE.DataUtils.toHalfFloat(Math.min(data[3 * i + c], 65504));
    out[4 * i + 3] = 0x3c00;
  }
  return out;
}

function faces(picture) {
  const n = picture.width, pixels = half(picture);
  return [...Array(6).keys()].map((f) => {
    const face = new THREE.DataTexture(pixels.slice(4 * f * n * n, 4 * (f + 1) * n * n), n, n);
    face.type = THREE.HalfFloatType;
    return face;
  });
}

function cubeTexture(pictures) {
  const [first, ...rest] = pictures.map(faces);
  const cube = new THREE.CubeTexture(first);
  cube.format = THREE.RGBAFormat;
  cube.type = THREE.HalfFloatType;
  cube.mipmaps = rest.map((images) => ({ image: images }));
  cube.minFilter = rest.length ? THREE.LinearMipmapLinearFilter : THREE.LinearFilter;
  cube.magFilter = THREE.LinearFilter;
  cube.generateMipmaps = false;
  cube.colorSpace = THREE.LinearSRGBColorSpace;
  cube.needsUpdate = true;
  return cube;
}

// table: rows of pairs, as make_scene.py writes them.
function albedoTexture(table) {
  const halves = new Uint16Array(table.flat(2).map(THREE.DataUtils.toHalfFloat));
  const texture = new THREE.DataTexture(halves, table[0].length, table.length, THREE.RGFormat, THREE.HalfFloatType);
  texture.minFilter = texture.magFilter = THREE.LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

// Returns {probe, prefiltered, levels, sh, albedo, background} of a folder that make_scene.py wrote: light.json,
// exported with layout "strip" and format "hdr", and the table of the albedo.
export async function loadLight(folder) {
  const light = await (await fetch(`${folder}/light.json`)).json();
  if (light.axes !== "gltf" || light.layout !== "strip") throw new Error("expected axes gltf and layout strip");
  const levels = light.prefiltered.levels;
  const pictures = await Promise.all(levels.map((level) => strip(`${folder}/${level.files[0]}`)));
  const environment = await strip(`${folder}/${light.environment}`);
  const background = new THREE.DataTexture(half(environment), environment.width, environment.height);
  background.type = THREE.HalfFloatType;
  background.mapping = THREE.EquirectangularReflectionMapping;
  background.colorSpace = THREE.LinearSRGBColorSpace;
  background.minFilter = background.magFilter = THREE.LinearFilter;
  background.flipY = true;
  background.needsUpdate = true;
  const sh = light.sh9.radiance.map((v) => new THREE.Vector3(...v));
  // The order and the basis are those of three.js: its LightProbe takes the coefficients as they are.
  const probe = new THREE.LightProbe(new THREE.SphericalHarmonics3().set(sh));
  const albedo = albedoTexture(await (await fetch(`${folder}/ggx_albedo.json`)).json());
  return { probe, sh, albedo, prefiltered: cubeTexture(pictures), levels: levels.length, background };
}
