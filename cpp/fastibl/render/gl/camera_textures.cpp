#include "fastibl/render/gl/camera_textures.h"

#include <cmath>
#include <vector>

#include "fastibl/shading/composite.h"

namespace fastibl {
namespace {

constexpr int kGuessRow = 64;  // 64² = 4096 guesses of a code

}  // namespace

void CameraTextures::upload_response(Gpu& gpu, const Response& response) {
  if (response_.id && response == response_of_) return;
  const ByteResponse table(response);
  const int white = table.encode(1);
  levels_ = glm::vec2(float(table.encode(0)), float(white)) / 255.0f;
  std::vector<float> rows(512);
  for (int k = 0; k < 256; ++k) {
    rows[std::size_t(k)] = table.decode(std::uint8_t(k));
    rows[256 + std::size_t(k)] = k < white ? response.decode((float(k) + 0.5f) / 255.0f) : 2.0f;
  }
  std::vector<glm::vec2> guesses(std::size_t(kGuessRow) * kGuessRow);
  steep_ = false;
  for (std::size_t i = 0; i < guesses.size(); ++i) {
    const float count = float(guesses.size());
    const std::size_t code = table.encode(float(i) / count);
    guesses[i] = glm::vec2(float(code), rows[256 + code]);
    steep_ = steep_ || (code < 255 && rows[256 + code + 1] < float(i + 1) / count);
  }
  gpu.allocate(response_, GL_R32F, 256, 2, GL_RED, GL_FLOAT, rows.data());
  gpu.allocate(guess_, GL_RG32F, kGuessRow, kGuessRow, GL_RG, GL_FLOAT, guesses.data());
  response_of_ = response;
}

void CameraTextures::upload_rays(Gpu& gpu, const Camera& camera) {
  if (rays_.id && camera == rays_of_) return;
  const PixelTable table(camera);
  std::vector<glm::vec2> xy;
  for (std::size_t i = 0; i < table.x.size(); ++i)
    xy.push_back(std::isnan(table.x[i]) ? glm::vec2(1e30f) : glm::vec2(table.x[i], table.y[i]));
  gpu.allocate(rays_, GL_RG32F, camera.width, camera.height, GL_RG, GL_FLOAT, xy.data());
  rays_of_ = camera;
}

void CameraTextures::bind_response(Gpu& gpu) const {
  gpu.bind("response", response_);
  gpu.bind("guess", guess_);
}

void CameraTextures::bind_rays(Gpu& gpu) const { gpu.bind("rays", rays_); }

}  // namespace fastibl
