// A metallic-roughness material that is lit by exported light alone.
import * as THREE from "three";

const vertexShader = `
varying vec3 v_normal, v_position;
void main() {
  v_normal = mat3(modelMatrix) * normal;  // rigid and uniformly scaled objects
  v_position = (modelMatrix * vec4(position, 1.0)).xyz;
  gl_Position = projectionMatrix * viewMatrix * vec4(v_position, 1.0);
}`;

const fragmentShader = `
uniform vec3 base_color, sh[9];
uniform float metallic, roughness, top_level;
uniform samplerCube prefiltered;
uniform sampler2D ggx_albedo;
varying vec3 v_normal, v_position;

vec3 irradiance(vec3 n) {
  vec3 sum = 0.282095 * 3.141593 * sh[0] + 0.488603 * 2.094395 * (sh[1] * n.y + sh[2] * n.z + sh[3] * n.x)
    + 0.785398 * (1.092548 * (sh[4] * n.x * n.y + sh[5] * n.y * n.z + sh[7] * n.x * n.z)
    + 0.315392 * sh[6] * (3.0 * n.z * n.z - 1.0) + 0.546274 * sh[8] * (n.x * n.x - n.y * n.y));
  return max(sum, 0.0);
}

// Directional albedo of single scattering: scale of F0, and the rest. Rows of the table are roughness from sqrt(0.02)
// to 1, columns the square root of the cosine.
vec2 albedo(float cos_view) {
  vec2 at = vec2(sqrt(cos_view), clamp((roughness - 0.141421) / 0.858579, 0.0, 1.0));
  vec2 size = vec2(textureSize(ggx_albedo, 0));
  return texture2D(ggx_albedo, (at * (size - 1.0) + 0.5) / size).rg;
}

// Turquin 2019: light that is scattered more than once has the shape of the lobe; a white metal loses none.
vec3 reflectance(vec3 f0, vec2 ab) {
  return (f0 * ab.x + ab.y) * (1.0 + f0 * (1.0 / (ab.x + ab.y) - 1.0));
}

void main() {
  vec3 n = normalize(v_normal), v = normalize(cameraPosition - v_position);
  vec2 ab = albedo(max(dot(n, v), 0.0));
  vec3 plain = reflectance(vec3(0.04), ab);
  vec3 specular = textureLod(prefiltered, reflect(-v, n), roughness * top_level).rgb
    * mix(plain, reflectance(base_color, ab), metallic);
  vec3 diffuse = (1.0 - metallic) * base_color * (1.0 - plain) * irradiance(n) / 3.141593;
  gl_FragColor = vec4(diffuse + specular, 1.0);
  #include <tonemapping_fragment>
  #include <colorspace_fragment>
}`;

export function litMaterial(light, { color = 0xffffff, metallic = 0, roughness = 0.5 } = {}) {
  return new THREE.ShaderMaterial({
    vertexShader,
    fragmentShader,
    uniforms: {
      base_color: { value: new THREE.Color(color) },
      metallic: { value: metallic },
      roughness: { value: roughness },
      top_level: { value: light.levels - 1 },
      sh: { value: light.sh },
      prefiltered: { value: light.prefiltered },
      ggx_albedo: { value: light.albedo },
    },
  });
}
