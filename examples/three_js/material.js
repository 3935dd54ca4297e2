// A metallic-roughness material lit by exported light alone.
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
varying vec3 v_normal, v_position;

vec3 irradiance(vec3 n) {
  vec3 sum = 0.282095 * 3.141593 * sh[0] + 0.488603 * 2.094395 * (sh[1] * n.y + sh[2] * n.z + sh[3] * n.x)
    + 0.785398 * (1.092548 * (sh[4] * n.x * n.y + sh[5] * n.y * n.z + sh[7] * n.x * n.z)
    + 0.315392 * sh[6] * (3.0 * n.z * n.z - 1.0) + 0.546274 * sh[8] * (n.x * n.x - n.y * n.y));
  return max(sum, 0.0);
}

// Karis 2014, Physically Based Shading on Mobile: scale and offset of F0 in the directional albedo.
vec2 albedo(float cos_view) {
  vec4 r = roughness * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
  float a = min(r.x * r.x, exp2(-9.28 * cos_view)) * r.x + r.y;
  return vec2(-1.04, 1.04) * a + r.zw;
}

void main() {
  vec3 n = normalize(v_normal), v = normalize(cameraPosition - v_position);
  vec3 f0 = mix(vec3(0.04), base_color, metallic);
  vec2 ab = albedo(max(dot(n, v), 0.0));
  vec3 specular = textureLod(prefiltered, reflect(-v, n), roughness * top_level).rgb * (f0 * ab.x + ab.y);
  vec3 diffuse = (1.0 - metallic) * base_color * irradiance(n) / 3.141593;
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
    },
  });
}
