#include "fastibl/capture/plane_meter.h"

#include <cmath>
#include <numbers>

#include "fastibl/scene/pixel_reader.h"

namespace fastibl {
namespace {

constexpr double kPause = 0.1;  // seconds between readings

}  // namespace

PlaneMeter::PlaneMeter(const std::optional<Board>& board, double albedo) {
  if (board) meter_.emplace(*board, albedo);
}

bool PlaneMeter::read(const PosedPicture& posed, const Taken& taken, double time) {
  if (!meter_ || std::abs(time - read_at_) < kPause) return false;
  const CameraSide& side = posed.side;
  auto read = meter_->read(posed.pixels(), side.camera, side.lens, posed.half(), taken.exposure);
  if (!read) return false;
  *read /= taken.tint;
  read_at_ = time, irradiance_ = read;
  return true;
}

std::optional<double> PlaneMeter::assumed_exposure(const Picture& picture,
                                                   const Camera& camera) const {
  if (!irradiance_) return std::nullopt;
  const ByteResponse bytes(camera.response);
  const PixelReader pixels(picture, camera.response, bytes);
  constexpr int kAcross = 32;
  double sum = 0;
  for (int j = 0; j < kAcross; ++j)
    for (int i = 0; i < kAcross; ++i) {
      const glm::vec3 linear =
          pixels.linear(i * picture.width / kAcross, j * picture.height / kAcross);
      sum += double(linear.x + linear.y + linear.z) / (3 * kAcross * kAcross);
    }
  const double radiance = grey(*irradiance_) / std::numbers::pi;
  const double exposure = sum / (radiance * camera.gain);
  if (!(exposure > 0) || !std::isfinite(exposure)) return std::nullopt;
  return exposure;
}

}  // namespace fastibl
