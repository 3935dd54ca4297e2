// Eight rays from one point through a Bvh; see core/wide.h. Included in namespaces `portable` and
// `avx2`.

#include "fastibl/core/wide.inl"

// Rays whose way through the box is not empty. Inverse directions are finite, so nothing is NaN;
// the last factor covers the rounding of both ends.
FASTIBL_KERNEL_INLINE unsigned meets_box(const Bvh::Node& node, const float* origin, Wide ix, Wide iy,
                                  Wide iz, Wide t_min) {
  const Wide ax = (node.lower.x - origin[0]) * ix, bx = (node.upper.x - origin[0]) * ix;
  const Wide ay = (node.lower.y - origin[1]) * iy, by = (node.upper.y - origin[1]) * iy;
  const Wide az = (node.lower.z - origin[2]) * iz, bz = (node.upper.z - origin[2]) * iz;
  const Wide near = larger(larger(smaller(ax, bx), smaller(ay, by)), larger(smaller(az, bz), t_min));
  const Wide far = smaller(smaller(larger(ax, bx), larger(ay, by)), larger(az, bz));
  return set_bits(near <= far * 1.000001f);
}

FASTIBL_KERNEL_INLINE float squared_to_middle(const Bvh::Node& node, const float* origin) {
  const float x = node.lower.x + node.upper.x - 2 * origin[0],
              y = node.lower.y + node.upper.y - 2 * origin[1],
              z = node.lower.z + node.upper.z - 2 * origin[2];
  return x * x + y * y + z * z;
}

// Bit k is set where ray k meets a triangle at t > t_min. Möller and Trumbore 1997; their products
// with the origin are the same for all eight rays.
FASTIBL_TARGET unsigned meets_any(const Bvh::Node* nodes, const Bvh::Corner* corners,
                                  const float* origin, const float* x, const float* y,
                                  const float* z, float least) {
  const Wide dx = *reinterpret_cast<const Unaligned*>(x),
             dy = *reinterpret_cast<const Unaligned*>(y),
             dz = *reinterpret_cast<const Unaligned*>(z);
  const Wide tiny = repeat(1e-20f), t_min = repeat(least);
  const Wide ix = 1 / (dx * dx > tiny * tiny ? dx : tiny),
             iy = 1 / (dy * dy > tiny * tiny ? dy : tiny),
             iz = 1 / (dz * dz > tiny * tiny ? dz : tiny);
  struct Entry {
    int node;
    unsigned rays;
  } stack[kBvhDepth + 1];
  unsigned hit = 0;
  int depth = 0;
  Entry now{0, meets_box(nodes[0], origin, ix, iy, iz, t_min)};
  while (true) {
    now.rays &= ~hit;
    if (now.rays) {
      const Bvh::Node& node = nodes[now.node];
      if (node.count == 0) {
        Entry a{now.node + 1, 0}, b{node.first, 0};
        a.rays = meets_box(nodes[a.node], origin, ix, iy, iz, t_min) & now.rays;
        b.rays = meets_box(nodes[b.node], origin, ix, iy, iz, t_min) & now.rays;
        if (a.rays && b.rays) {  // what is near hides more
          const bool swapped = squared_to_middle(nodes[b.node], origin) <
                               squared_to_middle(nodes[a.node], origin);
          stack[depth++] = swapped ? a : b;
          now = swapped ? b : a;
          continue;
        }
        if (a.rays || b.rays) {
          now = a.rays ? a : b;
          continue;
        }
      } else {
        for (const Bvh::Corner* c = corners + node.first; c < corners + node.first + node.count;
             ++c) {
          const float e1[3] = {c->edge1.x, c->edge1.y, c->edge1.z},
                      e2[3] = {c->edge2.x, c->edge2.y, c->edge2.z},
                      s[3] = {origin[0] - c->origin.x, origin[1] - c->origin.y,
                              origin[2] - c->origin.z};
          const float n[3] = {e2[1] * e1[2] - e2[2] * e1[1], e2[2] * e1[0] - e2[0] * e1[2],
                              e2[0] * e1[1] - e2[1] * e1[0]};  // e2 × e1
          const float p[3] = {e2[1] * s[2] - e2[2] * s[1], e2[2] * s[0] - e2[0] * s[2],
                              e2[0] * s[1] - e2[1] * s[0]};  // e2 × s
          const float q[3] = {s[1] * e1[2] - s[2] * e1[1], s[2] * e1[0] - s[0] * e1[2],
                              s[0] * e1[1] - s[1] * e1[0]};  // s × e1
          const float w = e2[0] * q[0] + e2[1] * q[1] + e2[2] * q[2];
          const Wide det = dx * n[0] + dy * n[1] + dz * n[2];
          const Wide inverse = 1 / det;  // ±inf where it is 0: u, v or t is then not in range
          const Wide u = (dx * p[0] + dy * p[1] + dz * p[2]) * inverse;
          const Wide v = (dx * q[0] + dy * q[1] + dz * q[2]) * inverse;
          const Wide t = w * inverse;
          const WideInt met =
              (u >= 0) & (v >= 0) & (u + v <= 1) & (t > t_min) & (det != 0);
          hit |= set_bits(met) & now.rays;
        }
        if (hit == 0xff) return hit;
      }
    }
    if (depth == 0) return hit;
    now = stack[--depth];
  }
}
