// glTF's metallic-roughness model and its textures, for C++ (through scene/shared_formulas.h) and GLSL ES 3.00.

// MIP level of a texture (size: of level 0, texels) whose texels are as large as the longer of two steps of uv.
FN float texture_level(vec2 size, vec2 uv_dx, vec2 uv_dy) {
  vec2 a = uv_dx * size;
  vec2 b = uv_dy * size;
  return 0.5f * log2(max(max(dot(a, a), dot(b, b)), 1e-12f));
}

// glTF mixes a metal, which reflects its colour at normal incidence, with a dielectric over a diffuse base; what the
// dielectric does not reflect goes into its base, of all colours as little as of that which it reflects most.
// dielectric: reflectance at normal incidence (4 % for index 1.5), and the strength of all that it reflects.
// front, edge: see ggx_reflected.
FN vec3 pbr_reflected(vec3 base_color, float metallic, vec4 dielectric, vec2 albedo, vec3 front, vec3 edge) {
  return (1.0f - metallic) * dielectric.w * ggx_reflected(vec3(dielectric), albedo, front, edge) +
         metallic * ggx_reflected(base_color, albedo, front, edge);
}
FN vec3 pbr_diffuse(vec3 base_color, float metallic, vec4 dielectric, vec2 albedo) {
  vec3 kept = dielectric.w * ggx_reflected(vec3(dielectric), albedo, vec3(albedo.x), vec3(albedo.y));
  return (1.0f - metallic) * base_color * max(1.0f - max(kept.x, max(kept.y, kept.z)), 0.0f);
}
