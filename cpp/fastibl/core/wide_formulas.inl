// What the formulas of shaders/shared need to be compiled for eight at once: GLSL's functions and
// vectors with Wide in place of float. Included after core/wide.inl; then
//
//   #define float Wide
//   #define FN FASTIBL_KERNEL_INLINE
//   #include "shaders/shared/…"
//   #undef FN
//   #undef float

#ifdef FASTIBL_IN_AVX2
FASTIBL_KERNEL_INLINE Wide sqrt(Wide a) { return _mm256_sqrt_ps(a); }
FASTIBL_KERNEL_INLINE Wide floor(Wide a) { return _mm256_floor_ps(a); }
FASTIBL_KERNEL_INLINE Wide gather(const float* from, WideInt at) {
  return _mm256_i32gather_ps(from, (__m256i)at, 4);
}
#else
FASTIBL_KERNEL_INLINE Wide sqrt(Wide a) {
  for (int k = 0; k < kWide; ++k) a[k] = std::sqrt(a[k]);
  return a;
}
FASTIBL_KERNEL_INLINE Wide floor(Wide a) {
  for (int k = 0; k < kWide; ++k) a[k] = std::floor(a[k]);
  return a;
}
FASTIBL_KERNEL_INLINE Wide gather(const float* from, WideInt at) {
  Wide a;
  for (int k = 0; k < kWide; ++k) a[k] = from[at[k]];
  return a;
}
#endif

// Where a is no number, max and clamp give b and the lower end.
FASTIBL_KERNEL_INLINE Wide max(Wide a, Wide b) { return larger(a, b); }
FASTIBL_KERNEL_INLINE Wide max(Wide a, float b) { return larger(a, repeat(b)); }
FASTIBL_KERNEL_INLINE Wide min(Wide a, Wide b) { return smaller(a, b); }
FASTIBL_KERNEL_INLINE Wide min(Wide a, float b) { return smaller(a, repeat(b)); }
FASTIBL_KERNEL_INLINE Wide clamp(Wide a, float lower, float upper) {
  return min(max(a, lower), upper);
}

// 2^x for |x| ≤ 126, and these ends beyond.
FASTIBL_KERNEL_INLINE Wide exp2(Wide x) {
  x = clamp(x, -126, 126);
  const Wide whole = floor(x + 0.5f), f = x - whole;
  Wide sum = repeat(1.5403530e-4f);  // ln(2)^k / k!
  for (const float c : {1.3333558e-3f, 9.6181291e-3f, 5.5504109e-2f, 0.24022651f, 0.69314718f, 1.0f})
    sum = multiply_add(sum, f, repeat(c));
  return sum * (Wide)((__builtin_convertvector(whole, WideInt) + 127) << 23);
}

FASTIBL_KERNEL_INLINE Wide abs(Wide a) { return larger(a, -a); }
FASTIBL_KERNEL_INLINE Wide step(Wide edge, float x) { return x < edge ? Wide{} : repeat(1); }
// log2 of a normal number, within 1e-6 and 1e-7 of the result.
FASTIBL_KERNEL_INLINE Wide log2(Wide x) {
  // x = 2^whole · m with m from √½ to √2.
  const WideInt bits = (WideInt)x, whole = (bits - 0x3f3504f3) >> 23;
  const Wide m = (Wide)(bits - (whole << 23));
  const Wide t = (m - 1) / (m + 1), t2 = t * t;  // log m = 2 atanh t
  Wide sum = repeat(2.8853901f / 9);
  for (const float c : {2.8853901f / 7, 2.8853901f / 5, 2.8853901f / 3, 2.8853901f})
    sum = multiply_add(sum, t2, repeat(c));
  return multiply_add(t, sum, __builtin_convertvector(whole, Wide));
}

struct vec2 {
  Wide x, y;
};
struct vec3 {
  Wide x, y, z;
};
struct vec4 {
  Wide x, y, z, w;
};
FASTIBL_KERNEL_INLINE vec3 operator+(vec3 a, vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
FASTIBL_KERNEL_INLINE vec3 operator-(vec3 a, vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
FASTIBL_KERNEL_INLINE vec3 operator*(Wide a, vec3 b) { return {a * b.x, a * b.y, a * b.z}; }
FASTIBL_KERNEL_INLINE vec3 operator*(vec3 a, Wide b) { return b * a; }
FASTIBL_KERNEL_INLINE vec3& operator+=(vec3& a, vec3 b) { return a = a + b; }
FASTIBL_KERNEL_INLINE vec3 max(vec3 a, float b) { return {max(a.x, b), max(a.y, b), max(a.z, b)}; }
FASTIBL_KERNEL_INLINE Wide dot(vec3 a, vec3 b) {
  return multiply_add(a.x, b.x, multiply_add(a.y, b.y, a.z * b.z));
}
FASTIBL_KERNEL_INLINE vec3 normalize(vec3 a) { return (1 / sqrt(dot(a, a))) * a; }
FASTIBL_KERNEL_INLINE vec3 cross(vec3 a, vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
FASTIBL_KERNEL_INLINE vec3 repeat(const float* p) { return {repeat(p[0]), repeat(p[1]), repeat(p[2])}; }
