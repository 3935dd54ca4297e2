// Textures that shaders read by index. Private to render/gl.
#pragma once

#include <algorithm>
#include <vector>

#include "fastibl/render/gl/gpu.h"

namespace fastibl {

inline constexpr int kTableRow = 1024;  // texels along a row, as in shared/pixel_parts.glsl

// Makes it of rows of kTableRow texels; `values` is padded to whole rows.
template <typename T>
void upload_table(Gpu& gpu, Texture& t, GLenum internal, GLenum format, GLenum type,
                  std::vector<T>& values) {
  const int rows = std::max(1, (int(values.size()) + kTableRow - 1) / kTableRow);
  values.resize(std::size_t(rows) * kTableRow);
  gpu.allocate(t, internal, kTableRow, rows, format, type, values.data());
}

inline void upload_table(Gpu& gpu, Texture& t, std::vector<glm::vec4>& values) {
  upload_table(gpu, t, GL_RGBA32F, GL_RGBA, GL_FLOAT, values);
}
inline void upload_table(Gpu& gpu, Texture& t, std::vector<glm::uvec4>& values) {
  upload_table(gpu, t, GL_RGBA32UI, GL_RGBA_INTEGER, GL_UNSIGNED_INT, values);
}

}  // namespace fastibl
