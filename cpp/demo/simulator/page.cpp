#include "demo/simulator/page.h"

#include <cmath>

#include "fastibl/scene/tag_codes.h"

namespace fastibl::demo {
namespace {

constexpr float kPaper = 0.80f, kInk = 0.045f;  // albedo
constexpr float kDensity = 2000;                // texels a metre

// Where in the tag (0 to 1, right and down) a place of the page is.
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
  constexpr int kFine = 3;  // points along a texel's edge: borders of tags are anywhere
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

std::optional<float> Page::albedo(glm::vec2 place) const {
  if (std::abs(place.x) >= half_.x || std::abs(place.y) >= half_.y) return std::nullopt;
  const glm::vec2 at = (place + half_) / (2.0f * half_) * glm::vec2(texels_) - 0.5f;
  const glm::ivec2 low = glm::clamp(glm::ivec2(glm::floor(at)), glm::ivec2(0), texels_ - 2);
  const glm::vec2 f = glm::clamp(at - glm::vec2(low), 0.0f, 1.0f);
  const float* p = &albedo_[std::size_t(low.y) * std::size_t(texels_.x) + std::size_t(low.x)];
  const float* q = p + texels_.x;
  return glm::mix(glm::mix(p[0], p[1], f.x), glm::mix(q[0], q[1], f.x), f.y);
}

}  // namespace fastibl::demo
