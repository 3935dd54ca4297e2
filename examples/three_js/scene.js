// Shows spheres from smooth to rough, a matte one lit by a LightProbe, and a figurine.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { loadLight } from "./light.js";
import { litMaterial } from "./material.js";

const renderer = new THREE.WebGLRenderer({ antialias: true });
renderer.setSize(innerWidth, innerHeight);
renderer.toneMapping = THREE.ACESFilmicToneMapping;
document.body.append(renderer.domElement);
const camera = new THREE.PerspectiveCamera(40, innerWidth / innerHeight, 0.1, 100);
const scene = new THREE.Scene();

const light = await loadLight(".");
scene.background = light.background;
scene.add(light.probe);

const ball = new THREE.SphereGeometry(0.45, 64, 32);
const place = (mesh, x, y) => scene.add(mesh) && mesh.position.set(x, y, 0);
for (let k = 0; k < 5; ++k) {
  const roughness = k / 4;
  place(new THREE.Mesh(ball, litMaterial(light, { metallic: 1, roughness })), k - 2, 0.55);
  place(new THREE.Mesh(ball, litMaterial(light, { color: 0xc04030, roughness })), k - 2, -0.5);
}
place(new THREE.Mesh(ball, new THREE.MeshLambertMaterial({ color: 0xffffff })), -1, -1.55);
const figurine = (await new GLTFLoader().loadAsync("figurine.glb")).scene;
figurine.traverse((part) => {
  if (part.isMesh) part.material = litMaterial(light, { color: 0xd0b080, roughness: 0.35 });
});
figurine.position.set(1, -2.0, 0);
scene.add(figurine);

const still = new URLSearchParams(location.search).has("still");
function draw(time) {
  const angle = still ? 0 : time / 4000;
  camera.position.set(6 * Math.sin(angle), -0.4, 6 * Math.cos(angle));
  camera.lookAt(0, -0.5, 0);
  renderer.render(scene, camera);
  document.title = "lit by fastibl";
  if (!still) requestAnimationFrame(draw);
}
draw(0);
