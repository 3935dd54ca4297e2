// Bilinear look-ups of eight directions in levels of cube maps (scene/cube_map.h). Included after
// core/wide.inl.

typedef float FourFloats __attribute__((vector_size(16), aligned(4)));

// As face_point(); s and t in [0, 1] also where a direction is of length 0 or no number.
struct WideFacePoint {
  WideInt face;
  Wide s, t;
};
FASTIBL_KERNEL_INLINE WideFacePoint face_point(Wide x, Wide y, Wide z) {
  const Wide none = {}, one = repeat(1), half = repeat(0.5f);
  const WideInt zero = {};
  const Wide ax = larger(x, -x), ay = larger(y, -y), az = larger(z, -z);
  const WideInt along_x = (ax >= ay) & (ax >= az), along_y = ~along_x & (ay >= az);
  const Wide axis = along_x ? x : along_y ? y : z, major = larger(axis, -axis);
  const WideInt back = axis < none;
  const Wide scale = half / larger(major, repeat(1e-30f));
  const Wide s = along_x ? (back ? z : -z) : along_y ? x : (back ? -x : x);
  const Wide t = along_y ? (back ? -z : z) : -y;
  // smaller() and larger() in this order turn NaN into a position inside.
  return {(along_x ? zero : along_y ? zero + 2 : zero + 4) - back,
          larger(smaller(multiply_add(s, scale, half), one), none),
          larger(smaller(multiply_add(t, scale, half), one), none)};
}

// Four texels of a level of n × n texels a face, with its border, and their weights. `at` and `row`, the step to
// the row below, count floats from the border's first texel of face 0.
struct WideTexels {
  WideInt at, row;
  Wide rest, right, lower, lower_right;
};
FASTIBL_KERNEL_INLINE WideTexels texels_at(const WideFacePoint& p, Wide n) {
  const WideInt size = __builtin_convertvector(n, WideInt);
  const Wide half = repeat(0.5f);
  const Wide u = multiply_add(p.s, n, half), v = multiply_add(p.t, n, half);
  const WideInt ix = __builtin_convertvector(u, WideInt), iy = __builtin_convertvector(v, WideInt);
  const Wide fx = u - __builtin_convertvector(ix, Wide), fy = v - __builtin_convertvector(iy, Wide);
  const WideInt row = 3 * (size + 2);
  const Wide lower_right = fx * fy, lower = fy - lower_right, right = fx - lower_right;
  return {p.face * (row * (size + 2)) + iy * row + ix * 3, row, 1 - fx - lower, right, lower, lower_right};
}

// The look-up of one of the eight, of which the fourth number means nothing; four floats can be
// loaded at each texel.
FASTIBL_KERNEL_INLINE FourFloats look_up(const float* texels, const WideTexels& t, int k) {
  const float* p = texels + t.at[k];
  const float* q = p + t.row[k];
  const auto load = [](const float* from) FASTIBL_TARGET {
    return *reinterpret_cast<const FourFloats*>(from);
  };
  return t.rest[k] * load(p) + t.right[k] * load(p + 3) + t.lower[k] * load(q) +
         t.lower_right[k] * load(q + 3);
}
