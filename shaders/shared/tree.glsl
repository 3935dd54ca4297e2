// Whether a ray meets the mesh: the same as scene/bvh.cpp, without a stack. Needs shared/pixel_parts.glsl.
// Nodes, two texels each: lower corner and the node that follows where this one is not met; upper corner and a leaf's
// first triangle, or -1. Then triangles, four texels each: a corner and 1 for the last four of a leaf; two edges; the
// second's cross product with the first, which would be rounding where a triangle has no area. Leaves are filled up to
// whole fours with triangles that nothing meets.
uniform sampler2D tree;
uniform int tree_nodes;

// Moeller and Trumbore 1997, Fast, Minimum Storage Ray/Triangle Intersection.
bool meets_triangle(vec3 origin, vec3 direction, int at) {
  vec3 edge1 = texelFetch(tree, texel(at + 1), 0).xyz, edge2 = texelFetch(tree, texel(at + 2), 0).xyz;
  float det = dot(direction, texelFetch(tree, texel(at + 3), 0).xyz);
  vec3 s = origin - texelFetch(tree, texel(at), 0).xyz, q = cross(s, edge1);
  float inverse = 1.0 / (det == 0.0 ? 1.0 : det);
  float u = dot(direction, cross(edge2, s)) * inverse, v = dot(direction, q) * inverse, t = dot(edge2, q) * inverse;
  return det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0;
}

// Goes on by a node, unless a leaf was reached: then `triangle` is its first.
void next_node(vec3 origin, vec3 inverse, inout int node, inout int triangle) {
  if (triangle >= 0 || node >= tree_nodes) return;
  vec4 lower = texelFetch(tree, texel(2 * node), 0), upper = texelFetch(tree, texel(2 * node + 1), 0);
  vec3 a = (lower.xyz - origin) * inverse, b = (upper.xyz - origin) * inverse;
  vec3 enter = min(a, b), leave = max(a, b);
  float near = max(max(enter.x, enter.y), max(enter.z, 0.0));
  float far = min(min(leave.x, leave.y), leave.z) * 1.000001;  // both are rounded
  bool met = near <= far;
  triangle = met ? int(upper.w) : -1;
  node = met ? node + 1 : int(lower.w);  // a leaf has no children: its next node follows, too
}

// Four steps at a time: Mesa's drivers in software end all loops of a shader after 65 535 rounds.
bool meets_mesh(vec3 origin, vec3 direction) {
  vec3 inverse = 1.0 / mix(direction, vec3(1e-20), lessThan(abs(direction), vec3(1e-20)));
  int node = 0, triangle = -1;
  while (triangle >= 0 || node < tree_nodes) {
    next_node(origin, inverse, node, triangle);
    next_node(origin, inverse, node, triangle);
    next_node(origin, inverse, node, triangle);
    next_node(origin, inverse, node, triangle);
    if (triangle < 0) continue;
    int at = 2 * tree_nodes + 4 * triangle;
    if (meets_triangle(origin, direction, at) || meets_triangle(origin, direction, at + 4) ||
        meets_triangle(origin, direction, at + 8) || meets_triangle(origin, direction, at + 12))
      return true;
    triangle = texelFetch(tree, texel(at), 0).w > 0.5 ? -1 : triangle + 4;
  }
  return false;
}
