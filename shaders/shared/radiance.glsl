// The cube map of radiance with its MIP chain.
uniform samplerCube radiance;
uniform float radiance_scale;  // stored values times this are radiance
uniform float top_level;       // of the chain

// Trilinear; its two levels are blended here, because drivers round the blend to a few bits, or skip parts of it.
vec3 sample_map(samplerCube map, vec3 direction, float level) {
  float clamped = clamp(level, 0.0, top_level);
  float k = floor(clamped);
  vec3 fine = textureLod(map, direction, k).rgb;
  vec3 coarse = textureLod(map, direction, min(k + 1.0, top_level)).rgb;
  return radiance_scale * (fine + (clamped - k) * (coarse - fine));
}
vec3 sample_radiance(vec3 direction, float level) { return sample_map(radiance, direction, level); }
