#include "fastibl/tracking/projected_tags.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fastibl/scene/tag_codes.h"

namespace fastibl {
namespace {

bool outside(const ProjectedTag& tag, const Camera& camera) {
  glm::dvec2 low = tag.nodes[0], high = tag.nodes[0];
  for (const glm::dvec2& p : tag.nodes) low = glm::min(low, p), high = glm::max(high, p);
  return high.x < 0 || high.y < 0 || low.x > camera.width || low.y > camera.height;
}

double module_of(const ProjectedTag& tag, int stride) {
  const int middle = stride / 2 * stride + stride / 2;
  const auto& n = tag.nodes;
  const glm::dvec2 u = n[std::size_t(middle + 1)] - n[std::size_t(middle)],
                   v = n[std::size_t(middle + stride)] - n[std::size_t(middle)];
  return std::abs(u.x * v.y - u.y * v.x) / std::max(glm::length(u), glm::length(v));
}

// Rows and flow of the nodes lie between those of the corners; stops at the first that is not seen.
void project_rolling(const TagPattern& tag, std::size_t stride, const Lens& lens, const Pose& pose,
                     const Rows& rows, std::vector<glm::dvec2>& out) {
  const std::size_t n = stride - 1, ends[4] = {0, n, n * stride, n * stride + n};
  Rows::Seen corners[4];
  double guess = 0;
  for (int k = 0; k < 4; ++k) {
    const auto seen = rows.project(lens, pose * glm::dvec3(tag.nodes[ends[k]], 0), guess);
    if (!seen) return;
    corners[k] = *seen, guess = seen->later;
  }
  for (std::size_t k = 0; k < tag.nodes.size(); ++k) {
    const double x = double(k % stride) / double(n), y = double(k / stride) / double(n);
    const double w[4] = {(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y};
    double later = 0;
    glm::dvec2 flow(0);
    for (int c = 0; c < 4; ++c) later += w[c] * corners[c].later, flow += w[c] * corners[c].flow;
    const auto pixel = rows.project(lens, pose * glm::dvec3(tag.nodes[k], 0), later, flow);
    if (!pixel) return;
    out.push_back(*pixel);
  }
}

}  // namespace

std::vector<ProjectedTag> project_tags(const BoardPattern& pattern, const Camera& camera,
                                       const Lens& lens, const Pose& pose, const Rows* rows) {
  std::vector<ProjectedTag> tags;
  if (!(pose.inverse().translation.z > 0)) return tags;  // its back is no board
  tags.reserve(pattern.tags.size());
  for (std::size_t k = 0; k < pattern.tags.size(); ++k) {
    ProjectedTag tag{k, {}, 0};
    tag.nodes.reserve(pattern.tags[k].nodes.size());
    if (rows) {
      project_rolling(pattern.tags[k], std::size_t(pattern.nodes()), lens, pose, *rows, tag.nodes);
    } else {
      for (const glm::dvec2& node : pattern.tags[k].nodes) {
        const auto pixel = lens.project(pose * glm::dvec3(node, 0));
        if (!pixel) break;
        tag.nodes.push_back(*pixel);
      }
    }
    if (tag.nodes.size() != pattern.tags[k].nodes.size() || outside(tag, camera)) continue;
    tag.module = module_of(tag, pattern.nodes());
    if (std::isfinite(tag.module)) tags.push_back(std::move(tag));
  }
  return tags;
}

double middle_share(const BoardPattern& pattern, const Camera& camera, const Lens& lens,
                    const Pose& pose) {
  double sum = 0;
  int count = 0;
  for (const TagPattern& tag : pattern.tags)
    if (const auto pixel = lens.project(pose * glm::dvec3(tag.nodes[tag.nodes.size() / 2], 0)))
      if (camera.inside(*pixel)) sum += pixel->y / camera.height, ++count;
  return count > 0 ? sum / count : 0.5;
}

glm::dvec2 module_middle(const BoardPattern& pattern, const ProjectedTag& tag, int row,
                         int column) {
  const auto node = std::size_t((row + pattern.border) * pattern.nodes() + column + pattern.border);
  return 0.5 * (tag.nodes[node] + tag.nodes[node + std::size_t(pattern.nodes()) + 1]);
}

double code_match(const LightReader& light, const BoardPattern& pattern, const ProjectedTag& tag) {
  const std::vector<bool>& black = pattern.tags[tag.index].black;
  int count = 0, whites = 0, sum = 0, squares = 0, white_sum = 0;
  for (int row = 0; row < kTagModules; ++row)
    for (int column = 0; column < kTagModules; ++column) {
      const glm::dvec2 p = module_middle(pattern, tag, row, column);
      if (!(p.x >= 0 && p.y >= 0 && p.x < light.width() && p.y < light.height())) continue;
      const int v = light.code(int(p.x), int(p.y));
      ++count, sum += v, squares += v * v;
      if (!black[std::size_t(row * kTagModules + column)]) ++whites, white_sum += v;
    }
  if (count < kTagModules * kTagModules / 2) return 0;
  const double n = count, w = whites;
  const double spread = (n * squares - double(sum) * sum) * (w * (n - w));
  return spread > 0 ? (n * white_sum - w * sum) / std::sqrt(spread) : 0;
}

}  // namespace fastibl
