// What needs no screen: three.js' LightProbe, ktx-parse (which writes theirs.ktx2), the Khronos validator of glTF.
import { readFileSync, writeFileSync } from "node:fs";
import * as THREE from "three";
import { read, write } from "ktx-parse";
import validator from "gltf-validator";

const { folder, normals } = JSON.parse(readFileSync(0));
const bytes = (name) => new Uint8Array(readFileSync(`${folder}/${name}`));

const probe = new THREE.ObjectLoader().parse(JSON.parse(readFileSync(`${folder}/probe.json`)));
const irradiance = normals.map((n) => probe.sh.getIrradianceAt(new THREE.Vector3(...n), new THREE.Vector3()).toArray());

const cube = read(bytes("prefiltered.ktx2"));
writeFileSync(`${folder}/theirs.ktx2`, write(cube));
const texture = {
  format: cube.vkFormat, faces: cube.faceCount, size: cube.pixelWidth, levels: cube.levels.map((l) => l.levelData.length),
  transfer: cube.dataFormatDescriptor[0].transferFunction, keys: Object.keys(cube.keyValue),
};
const report = await validator.validateBytes(bytes("light.glb"));
const { numErrors, numWarnings } = report.issues;
console.log(JSON.stringify({ irradiance, texture, gltf: { numErrors, numWarnings, messages: report.issues.messages } }));
