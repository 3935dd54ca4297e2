// Triangles on their way to bits of the plane; see core/wide.h for how it is compiled.

#include "fastibl/core/wide.inl"

// Position on the grid, centres of texels at whole numbers.
FASTIBL_TARGET void project(const float* x, const float* y, const float* z, int count,
                            const float* slope, const float* shift, float scale, float* px,
                            float* py) {
  const float slope_x = slope[0], slope_y = slope[1], shift_x = shift[0], shift_y = shift[1];
  for (int i = 0; i < count; ++i) {
    const float u = (x[i] - z[i] * slope_x) * scale + shift_x,
                v = (y[i] - z[i] * slope_y) * scale + shift_y;
    // In this order a NaN becomes a number too.
    px[i] = std::min(kFar, std::max(-kFar, u));
    py[i] = std::min(kFar, std::max(-kFar, v));
  }
}

// rows[i]: the number of rows with texel centres in the box around triangle i, 0 if the box holds no
// texel centre.
FASTIBL_TARGET void count_rows(const std::int32_t* a, const std::int32_t* b, const std::int32_t* c, int count,
                const float* px, const float* py, float last, std::int32_t* rows) {
  for (int i = 0; i < count; ++i) {
    const float ax = px[a[i]], bx = px[b[i]], cx = px[c[i]];
    const float ay = py[a[i]], by = py[b[i]], cy = py[c[i]];
    const float x0 = std::max(std::min(std::min(ax, bx), cx), 0.0f),
                x1 = std::min(std::max(std::max(ax, bx), cx), last);
    const float y0 = std::max(std::min(std::min(ay, by), cy), 0.0f),
                y1 = std::min(std::max(std::max(ay, by), cy), last);
    // ⌈x0⌉ ≤ ⌊x1⌋; conversions of other numbers than those from 0 to the last texel are not used.
    const std::int32_t i0 = std::int32_t(x0), i1 = std::int32_t(x1), j0 = std::int32_t(y0),
                       j1 = std::int32_t(y1);
    const std::int32_t ci = i0 + (float(i0) < x0), cj = j0 + (float(j0) < y0);
    const bool met = (x0 <= x1) & (y0 <= y1) & (ci <= i1) & (cj <= j1);
    rows[i] = met ? j1 - cj + 1 : 0;
  }
}

FASTIBL_KERNEL_INLINE WideInt whole(Wide a) { return __builtin_convertvector(a, WideInt); }
FASTIBL_KERNEL_INLINE Wide numbers(WideInt a) { return __builtin_convertvector(a, Wide); }

// Triangles of at most kLow rows, which most are: by the arithmetic of draw_triangle, and without a
// branch that depends on a triangle.
FASTIBL_TARGET void draw_low(const std::int32_t* chosen, int count, const std::int32_t* a,
                             const std::int32_t* b, const std::int32_t* c, const float* px,
                             const float* py, float last_texel, std::ptrdiff_t stride,
                             std::uint64_t* words) {
  const Wide none = repeat(0), one = repeat(1), last = repeat(last_texel);
  for (int begin = 0; begin < count; begin += kWide) {
    Wide x[3], y[3], slope[3], low[3], high[3];
    for (int l = 0; l < kWide; ++l) {
      const int i = chosen[std::min(begin + l, count - 1)];
      x[0][l] = px[a[i]], y[0][l] = py[a[i]];
      x[1][l] = px[b[i]], y[1][l] = py[b[i]];
      x[2][l] = px[c[i]], y[2][l] = py[c[i]];
    }
    for (int k = 0; k < 3; ++k) {
      const int from = k == 2 ? 0 : k, to = k == 0 ? 1 : 2;
      const Wide rise = y[to] - y[from];
      const WideInt flat = rise == none;
      slope[k] = flat ? none : (x[to] - x[from]) / (flat ? one : rise);
      low[k] = flat ? one : smaller(y[from], y[to]);
      high[k] = flat ? none : larger(y[from], y[to]);
    }
    const Wide y0 = larger(smaller(smaller(y[0], y[1]), y[2]), none),
               y1 = smaller(larger(larger(y[0], y[1]), y[2]), last);
    const Wide floor0 = numbers(whole(y0));
    const Wide first_row = floor0 + (floor0 < y0 ? one : none), last_row = numbers(whole(y1)),
               rows = last_row - first_row;
    float most = 0;
    for (int l = 0; l < kWide; ++l) most = std::max(most, rows[l]);
    for (int r = 0; r <= int(most); ++r) {
      const Wide at = first_row + repeat(float(r));
      Wide left = repeat(kFar), right = repeat(-kFar);
      for (int k = 0; k < 3; ++k) {
        const int from = k == 2 ? 0 : k;
        const Wide cross = x[from] + (at - y[from]) * slope[k];
        const WideInt met = (at >= low[k]) & (at <= high[k]);
        left = met ? smaller(cross, left) : left;
        right = met ? larger(cross, right) : right;
      }
      left = larger(left, none), right = smaller(right, last);
      const WideInt some = (left <= right) & (at <= last_row);
      left = some ? left : one, right = some ? right : none;
      const WideInt floor_left = whole(left);
      const WideInt start = floor_left - (numbers(floor_left) < left), end = whole(right),
                    row = whole(some ? at : none);
      for (int l = 0; l < kWide; ++l) {
        // Bits s … e of one word, none where s > e.
        const int s = start[l], e = end[l];
        const std::uint64_t bits =
            (~std::uint64_t{0} << (s & 63)) & (~std::uint64_t{0} >> (63 - (e & 63)));
        if ((e >> 6) > (s >> 6))
          set_span(words + row[l], stride, s, e);
        else
          words[(e >> 6) * stride + row[l]] |= e < s ? 0 : bits;
      }
    }
  }
}
