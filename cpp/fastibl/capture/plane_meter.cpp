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
  auto read = meter_->read(posed.pixels(), side.camera, side.lens, posed.half(), taken.exposure,
                           posed.hidden);
  if (!read) return false;
  *read /= taken.tint;
  read_at_ = time, irradiance_ = read;
  return true;
}

std::optional<double> PlaneMeter::exposure_by_white(const PosedPicture& posed) const {
  if (!meter_ || !irradiance_) return std::nullopt;
  const CameraSide& side = posed.side;
  const auto shown =
      meter_->read(posed.pixels(), side.camera, side.lens, posed.half(), 1, posed.hidden);
  const double exposure = shown ? grey(*shown) / grey(*irradiance_) : 0;
  if (!(exposure > 0) || !std::isfinite(exposure)) return std::nullopt;
  return exposure;
}

void PictureMean::add(const PosedPicture& posed) {
  constexpr int kAcross = 32;
  const Camera& camera = posed.side.camera;
  const PixelReader pixels = posed.pixels();
  for (int j = 0; j < kAcross; ++j)
    for (int i = 0; i < kAcross; ++i) {
      const int x = i * camera.width / kAcross, y = j * camera.height / kAcross;
      if (!posed.shows(x, y)) continue;
      const glm::vec3 linear = pixels.linear(x, y);
      sum_ += double(linear.x + linear.y + linear.z) /
              (3 * camera.gain * posed.side.vignette(float(x) + 0.5f, float(y) + 0.5f));
      ++count_;
    }
}

std::optional<double> PlaneMeter::exposure_by_mean(const PictureMean& mean) const {
  if (!irradiance_) return std::nullopt;
  const double radiance = grey(*irradiance_) / std::numbers::pi;
  const double exposure = mean.value() / radiance;
  if (!(exposure > 0) || !std::isfinite(exposure)) return std::nullopt;
  return exposure;
}

}  // namespace fastibl
