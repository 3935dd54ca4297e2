// Irradiance of many normals; see core/wide.h for how it is compiled. Counts are whole blocks.

#include "fastibl/core/wide.inl"
#include "fastibl/scene/cube_kernel.inl"

// Eq. 9. faces: 6 × RGB, over 1.75.
FASTIBL_TARGET void six_face_block(const float* __restrict normals, int count, const float* faces,
                                   float* __restrict out) {
  const Wide shift = repeat(0.75f), none = {};
  Wide face[18];
  for (int i = 0; i < 18; ++i) face[i] = repeat(faces[i]);
  for (int i = 0; i < count; i += kWide, normals += 3 * kWide, out += 3 * kWide) {
    Wide x, y, z;
    load_vectors(normals, x, y, z);
    Wide weight[6] = {shift + x, shift - x, shift + y, shift - y, shift + z, shift - z};
    for (Wide& w : weight) w = larger(w, none), w *= w;
    Wide sum[3];
    for (int c = 0; c < 3; ++c) {
      sum[c] = weight[0] * face[c];
      for (int f = 1; f < 6; ++f) sum[c] = multiply_add(weight[f], face[3 * f + c], sum[c]);
    }
    store_vectors(out, sum[0], sum[1], sum[2]);
  }
}

FASTIBL_KERNEL_INLINE Wide lobe(Wide x, Wide y, Wide z, const Wide* axis) {
  return larger(multiply_add(x, axis[0], multiply_add(y, axis[1], z * axis[2])), Wide{});
}

// Nine coefficients and lobes; two registers of normals at once, so that a coefficient is loaded
// for both. See LobesKernel. Known: the number of lobes where it is small and of one colour, or −1.
template <int Known>
FASTIBL_TARGET void lobes_block(const float* __restrict normals, int count, const LobesKernel& k,
                                float* __restrict out) {
  const Wide none = {};
  Wide coefficients[3][9], axes[kMostLobes][3], colours[2][3];
  for (int c = 0; c < 3; ++c) {
    for (int i = 0; i < 9; ++i) coefficients[c][i] = repeat(k.coefficients[c][i]);
    for (int l = 0; l < kMostLobes; ++l) axes[l][c] = repeat(k.axes[l][c]);
    for (int g = 0; g < 2; ++g) colours[g][c] = repeat(k.colours[g][c]);
  }
  const int first = Known < 0 ? k.counts[0] : Known, all = first + (Known < 0 ? k.counts[1] : 0);
  for (int i = 0; i < count; i += 2 * kWide, normals += 6 * kWide, out += 6 * kWide) {
    Wide x[2], y[2], z[2], one[2] = {}, other[2] = {};
    for (int u = 0; u < 2; ++u) load_vectors(normals + 3 * kWide * u, x[u], y[u], z[u]);
    for (int l = 0; l < first; ++l)
      for (int u = 0; u < 2; ++u) one[u] += lobe(x[u], y[u], z[u], axes[l]);
    for (int l = first; l < all; ++l)
      for (int u = 0; u < 2; ++u) other[u] += lobe(x[u], y[u], z[u], axes[l]);
    Wide sum[3][2];
    for (int c = 0; c < 3; ++c) {
      const Wide* p = coefficients[c];
      for (int u = 0; u < 2; ++u) {
        const Wide in_x =
            multiply_add(z[u], p[4], multiply_add(y[u], p[3], multiply_add(x[u], p[2], p[1])));
        const Wide in_y = multiply_add(z[u], p[7], multiply_add(y[u], p[6], p[5]));
        Wide e = multiply_add(x[u], in_x, multiply_add(y[u], in_y, multiply_add(z[u], p[8], p[0])));
        if (Known != 0) e = multiply_add(one[u], colours[0][c], e);
        if (Known < 0) e = multiply_add(other[u], colours[1][c], e);
        sum[c][u] = larger(e, none);
      }
    }
    for (int u = 0; u < 2; ++u) store_vectors(out + 3 * kWide * u, sum[0][u], sum[1][u], sum[2][u]);
  }
}

FASTIBL_TARGET void lobes_of(const float* normals, int count, const LobesKernel& k, float* out) {
  if (k.counts[1] > 0) return lobes_block<-1>(normals, count, k, out);
  switch (k.counts[0]) {
    case 0:
      return lobes_block<0>(normals, count, k, out);
    case 1:
      return lobes_block<1>(normals, count, k, out);
    case 2:
      return lobes_block<2>(normals, count, k, out);
    case 3:
      return lobes_block<3>(normals, count, k, out);
    case 4:
      return lobes_block<4>(normals, count, k, out);
    default:
      return lobes_block<-1>(normals, count, k, out);
  }
}

// Bilinear look-ups in a level with a border. texels: of the border's first texel of face 0; four
// floats can be loaded at each.
FASTIBL_TARGET void cube_block(const float* __restrict normals, int count, const float* texels,
                               int size, float* __restrict out) {
  for (int i = 0; i < count; i += kWide, normals += 3 * kWide, out += 3 * kWide) {
    Wide x, y, z;
    load_vectors(normals, x, y, z);
    const WideTexels places = texels_at(face_point(x, y, z), repeat(float(size)));
    for (int k = 0; k < kWide; ++k) {
      const FourFloats sum = look_up(texels, places, k);
      out[3 * k] = sum[0], out[3 * k + 1] = sum[1], out[3 * k + 2] = sum[2];
    }
  }
}
