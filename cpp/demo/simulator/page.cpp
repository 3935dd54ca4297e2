#include "demo/simulator/page.h"

#include <algorithm>
#include <cmath>

#include "fastibl/scene/tag_codes.h"

namespace fastibl::demo {
namespace {

constexpr float kPaper = 0.80f, kInk = 0.045f;  // albedo
constexpr float kDensity = 2000;                // texels per metre

// Where a place of the page lies in the tag (0 to 1, right and down).
glm::dvec2 in_tag(const Tag& tag, const glm::dvec2& place) {
  const glm::dvec2 right = tag.corners[1] - tag.corners[0], down = tag.corners[3] - tag.corners[0];
  const glm::dvec2 off = place - tag.corners[0];
  return {glm::dot(off, right) / glm::dot(right, right),
          glm::dot(off, down) / glm::dot(down, down)};
}

bool black(const Tag& tag, int border_bits, const glm::dvec2& place) {
  const glm::dvec2 at = in_tag(tag, place);
  if (at.x < 0 || at.y < 0 || at.x >= 1 || at.y >= 1) return false;
  const int modules = kTagModules + 2 * border_bits;
  const int column = int(at.x * modules) - border_bits;
  const int row = int(at.y * modules) - border_bits;
  const bool border = column < 0 || row < 0 || column >= kTagModules || row >= kTagModules;
  return border || tag_module_black(tag.id, row, column);
}

}  // namespace

Page::Page(const Board& board)
    : half_(float(board.width / 2), float(board.height / 2)),
      texels_(int(std::lround(board.width * kDensity)), int(std::lround(board.height * kDensity))) {
  constexpr int kFine = 3;  // points along a texel's edge, since borders of tags lie anywhere
  albedo_.assign(std::size_t(texels_.x) * std::size_t(texels_.y), kPaper);
  const glm::dvec2 step(board.width / texels_.x, board.height / texels_.y);
  for (const Tag& tag : board.tags) {
    glm::dvec2 low = tag.corners[0], high = low;
    for (const glm::dvec2& corner : tag.corners)
      low = glm::min(low, corner), high = glm::max(high, corner);
    const glm::ivec2 first = glm::max(glm::ivec2((low + glm::dvec2(half_)) / step), 0);
    const glm::ivec2 last =
        glm::min(glm::ivec2((high + glm::dvec2(half_)) / step) + 1, texels_ - 1);
    for (int y = first.y; y <= last.y; ++y)
      for (int x = first.x; x <= last.x; ++x) {
        int ink = 0;
        for (int k = 0; k < kFine * kFine; ++k) {
          const glm::dvec2 at(x + (k % kFine + 0.5) / kFine, y + (k / kFine + 0.5) / kFine);
          ink += black(tag, board.border_bits, at * step - glm::dvec2(half_));
        }
        float& albedo = albedo_[std::size_t(y) * std::size_t(texels_.x) + std::size_t(x)];
        albedo += (kInk - kPaper) * float(ink) / (kFine * kFine);
      }
  }
}

Page::Paper Page::at(const Float4& x, const Float4& y) const {
  const glm::vec2 scale = glm::vec2(texels_) / (2.0f * half_);
  const Float4 s = (x + half_.x) * scale.x - 0.5f, t = (y + half_.y) * scale.y - 0.5f;
  Paper paper;
  for (int k = 0; k < 4; ++k) {
    if (!(std::abs(x[k]) < half_.x && std::abs(y[k]) < half_.y)) continue;
    const int column = std::clamp(int(s[k]), 0, texels_.x - 2);
    const int row = std::clamp(int(t[k]), 0, texels_.y - 2);
    const float fx = std::clamp(s[k] - float(column), 0.0f, 1.0f);
    const float fy = std::clamp(t[k] - float(row), 0.0f, 1.0f);
    const float* p = &albedo_[std::size_t(row) * std::size_t(texels_.x) + std::size_t(column)];
    const float* q = p + texels_.x;
    paper.albedo += glm::mix(glm::mix(p[0], p[1], fx), glm::mix(q[0], q[1], fx), fy);
    paper.share += 0.25f;
  }
  if (paper.share > 0) paper.albedo *= 0.25f / paper.share;
  return paper;
}

}  // namespace fastibl::demo
