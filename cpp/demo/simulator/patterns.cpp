#include "demo/simulator/patterns.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace fastibl::demo {
namespace {

float hash(int x, int y = 0) {  // [0, 1)
  std::uint32_t h = std::uint32_t(x) * 0x9E3779B1u ^ std::uint32_t(y) * 0x85EBCA77u;
  h ^= h >> 15, h *= 0x2C1B3C6Du, h ^= h >> 12, h *= 0x297A2D39u, h ^= h >> 15;
  return float(h >> 8) / float(1 << 24);
}

float noise(float x, float y) {  // smooth, [0, 1]
  const float fx = std::floor(x), fy = std::floor(y);
  const int ix = int(fx), iy = int(fy);
  const auto ease = [](float t) { return t * t * (3 - 2 * t); };
  const float s = ease(x - fx), t = ease(y - fy);
  return glm::mix(glm::mix(hash(ix, iy), hash(ix + 1, iy), s),
                  glm::mix(hash(ix, iy + 1), hash(ix + 1, iy + 1), s), t);
}

bool within(float a, float b, float a0, float b0, float a1, float b1) {
  return a >= a0 && a < a1 && b >= b0 && b < b1;
}
bool near(float a, float b, float a0, float b0, float radius) {
  return glm::length(glm::vec2(a - a0, b - b0)) < radius;
}

glm::vec3 plaster(float a, float b, glm::vec3 colour) {
  return colour * (0.97f + 0.06f * noise(9 * a, 9 * b));
}

glm::vec3 boards(float a, float b, float width, glm::vec3 colour) {
  const int board = int(std::floor(b / width));
  const float along = a + 7 * hash(board, 3);
  const float grain = noise(4 * along, 120 * b) + 0.6f * noise(14 * along, 400 * b) +
                      std::sin(60 * b + 5 * noise(1.7f * along, 10 * b));
  const float shade = 1 + 0.14f * (hash(board) - 0.5f) + 0.07f * (grain - 0.8f);
  const bool gap = std::abs(b / width - std::round(b / width)) * width < 0.0015f;
  return colour * (gap ? 0.65f : shade);
}

}  // namespace

Paint shelf_wall(float a, float b) {
  if (!within(a, b, 0.5f, 0, 2.7f, 2)) return {plaster(a, b, {0.68f, 0.64f, 0.55f})};
  const glm::vec3 wood(0.10f, 0.047f, 0.022f);
  const int shelf = int(b / 0.39f);
  const float up = b - 0.39f * float(shelf);
  if (up < 0.05f || a < 0.56f || a > 2.64f) return {wood};
  const int book = int(a / 0.045f);
  if (up > 0.22f + 0.1f * hash(book, shelf) || hash(shelf, book) < 0.1f) return {wood * 0.3f};
  const float hue = hash(book, shelf + 50);
  const glm::vec3 spine =
      glm::vec3(0.35f) + 0.3f * glm::cos(6.2832f * (glm::vec3(0, 0.33f, 0.67f) + hue));
  const bool band = std::abs(up - 0.18f) < 0.008f;
  return {spine * (band ? 1.6f : 1.0f) * (std::fmod(a, 0.045f) < 0.004f ? 0.4f : 1.0f)};
}

Paint door_wall(float a, float b) {
  if (within(a, b, 0.68f, 0, 1.64f, 2.08f)) {
    const bool panel =
        within(a, b, 0.8f, 0.15f, 1.52f, 0.85f) || within(a, b, 0.8f, 1.0f, 1.52f, 1.95f);
    return {near(a, b, 1.56f, 0.93f, 0.035f)
                ? glm::vec3(0.8f, 0.6f, 0.2f)
                : boards(b, a, 0.2f, {0.2f, 0.085f, 0.033f}) * (panel ? 0.6f : 1.0f)};
  }
  if (within(a, b, 0.6f, 0, 1.72f, 2.16f)) return {glm::vec3(0.8f)};
  if (within(a, b, 2.35f, 0.75f, 3.15f, 1.9f)) {
    if (near(a, b, 2.85f, 1.53f, 0.2f)) return {{0.45f, 0.015f, 0.022f}};
    return {near(a, b, 2.75f, 1.47f, 0.26f) ? glm::vec3(0.9f, 0.8f, 0.65f)
                                            : glm::vec3(0.45f, 0.015f, 0.022f)};
  }
  return {plaster(a, b, {0.62f, 0.32f, 0.15f})};
}

Paint picture_wall(float a, float b) {
  for (int k = 0; k < 3; ++k) {
    const float left = 0.45f + 0.6f * float(k);
    if (!within(a, b, left - 0.05f, 1.2f, left + 0.45f, 1.85f)) continue;
    if (!within(a, b, left, 1.25f, left + 0.4f, 1.8f)) return {glm::vec3(0.9f)};
    const glm::vec3 accent(k == 0 ? 0.55f : 0.04f, k == 1 ? 0.3f : 0.06f, k == 2 ? 0.4f : 0.03f);
    return {near(a, b, left + 0.2f, 1.55f, 0.13f) ? accent : glm::vec3(0.75f, 0.7f, 0.6f)};
  }
  if (near(a, b, 4.3f, 1.75f, 0.24f)) {  // a clock
    const glm::vec2 hand(a - 4.3f, b - 1.75f);
    const bool dark = glm::length(hand) > 0.215f || (std::abs(hand.x) < 0.01f && hand.y > 0) ||
                      (std::abs(hand.y - 0.3f * hand.x) < 0.012f && hand.x < 0);
    return {dark ? glm::vec3(0.02f) : glm::vec3(0.88f)};
  }
  if (within(a, b, 3.5f, 0, 5.7f, 0.7f)) {
    const bool knob = near(std::fmod(a - 3.5f, 0.733f), b, 0.37f, 0.5f, 0.02f);
    const bool gap = std::fmod(a - 3.5f, 0.733f) < 0.02f;
    return {glm::vec3(0.78f, 0.73f, 0.63f) * (knob || gap ? 0.25f : 1.0f)};
  }
  const glm::vec3 teal(0.05f, 0.27f, 0.26f);
  return {plaster(a, b, std::fmod(a, 0.5f) < 0.06f ? teal * 0.75f : teal)};
}

Paint window_wall(float a, float b) {
  for (const float left : {0.65f, 3.0f}) {
    const float x = a - left, y = b - 0.6f;  // in a window of 1.2 m × 1.35 m
    for (const float side : {-0.38f, 1.32f})
      if (within(x, b, side, 0.1f, side + 0.26f, 2.15f))
        return {glm::vec3(0.58f, 0.31f, 0.03f) * (std::fmod(x - side, 0.052f) < 0.02f ? 0.6f : 1)};
    if (!within(x, y, -0.08f, -0.08f, 1.28f, 1.43f)) continue;
    const bool bar = std::abs(x - 0.6f) < 0.025f || std::abs(y - 0.92f) < 0.025f;
    if (bar || !within(x, y, 0, 0, 1.2f, 1.35f)) return {glm::vec3(0.81f)};
    const float roof = 0.35f + 0.2f * hash(int(a / 0.22f), 9);
    if (y < roof) {
      const bool pane = std::fmod(x, 0.09f) < 0.03f && std::fmod(y, 0.12f) < 0.05f;
      return {glm::vec3(0),
              glm::vec3(14, 11, 8) * (0.6f + hash(int(a / 0.22f))) * (pane ? 0.4f : 1.0f)};
    }
    const float cloud =
        glm::smoothstep(0.55f, 0.9f, 0.6f * noise(3 * a, 4 * b) + 0.4f * noise(9 * a, 11 * b));
    return {glm::vec3(0), glm::mix(glm::vec3(34, 43, 57), glm::vec3(130, 125, 118), cloud)};
  }
  const float below = std::min(std::abs(a - 1.25f), std::abs(a - 3.6f));
  if (below < 0.55f && b > 0.08f && b < 0.44f)
    return {glm::vec3(std::fmod(a, 0.06f) < 0.02f ? 0.5f : 0.86f)};
  return {plaster(a, b, {0.72f, 0.69f, 0.63f})};
}

Paint ceiling(float a, float b) {
  if (within(a, b, 2.0f, 2.2f, 3.2f, 2.8f)) return {glm::vec3(0), {24, 23, 21}};
  if (within(a, b, 1.97f, 2.17f, 3.23f, 2.83f)) return {glm::vec3(0.48f)};
  return {plaster(a, b, {0.83f, 0.8f, 0.76f})};
}

Paint floor_boards(float a, float b) {
  const float r = glm::length(glm::vec2(a - 2.6f, 0.8f * (b - 2)));
  if (r < 1.45f) {
    const bool ring = std::fmod(r, 0.3f) < 0.06f;
    return {(ring ? glm::vec3(0.55f, 0.45f, 0.3f) : glm::vec3(0.2f, 0.05f, 0.05f)) *
            (0.85f + 0.3f * noise(60 * a, 60 * b))};
  }
  return {boards(a, b, 0.14f, {0.3f, 0.19f, 0.1f})};
}

Paint table_top(float a, float b) { return {boards(a, b, 0.12f, {0.36f, 0.24f, 0.14f})}; }

}  // namespace fastibl::demo
