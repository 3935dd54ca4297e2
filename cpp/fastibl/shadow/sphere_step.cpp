#include "fastibl/shadow/sphere_step.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/solve.h"

namespace fastibl {

float move_spheres(std::vector<SphereEquations>& equations, const Inside& is_inside,
                   SphereSet& spheres) {
  float farthest = 0;
  for (std::size_t j = 0; j < spheres.size(); ++j) {
    SphereEquations& q = equations[j];
    if (!(q.weight > 0)) continue;
    for (std::size_t a = 0; a < 4; ++a) q.matrix[5 * a] += 0.02 * q.weight;
    if (!solve_in_place(q.matrix, q.right)) continue;
    const auto& x = q.right;
    const glm::vec4 change = 0.7f * glm::vec4(x[0], x[1], x[2], x[3]);
    const float most = std::max(1.0f, 0.2f * spheres[j].w), length = glm::length(change);
    const glm::vec4 before = spheres[j];
    spheres[j] += length > most ? change * (most / length) : change;
    if (!is_inside(glm::vec3(spheres[j]))) spheres[j] = glm::vec4(glm::vec3(before), spheres[j].w);
    spheres[j].w = std::max(spheres[j].w, 0.3f);
    farthest = std::max(
        farthest, glm::length(glm::vec3(spheres[j] - before)) + std::abs(spheres[j].w - before.w));
  }
  return farthest;
}

}  // namespace fastibl
