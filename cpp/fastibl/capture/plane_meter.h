// The light that falls on the plane, as the board's white in pictures shows it.
#pragma once

#include <optional>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/exposure_doubt.h"
#include "fastibl/capture/light_meter.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// Of light, by channel: without its colour.
inline double grey(const glm::dvec3& light) { return (light.x + light.y + light.z) / 3; }

// The mean of what a picture shows, side by side: linear values by the camera's gain and without
// its vignetting, where it is not masked.
class PictureMean {
 public:
  void add(const PosedPicture& posed);
  double value() const { return count_ > 0 ? sum_ / count_ : 0; }

 private:
  double sum_ = 0;
  int count_ = 0;
};

class PlaneMeter {
 public:
  // albedo: of the board's paper. Without a board nothing is ever read.
  PlaneMeter(const std::optional<Board>& board, double albedo);

  // True if the picture shows the board's white well enough. After each reading the meter pauses.
  bool read(const PosedPicture& posed, const Taken& taken, double time);
  // What it read last.
  const std::optional<glm::dvec3>& irradiance() const { return irradiance_; }
  void forget() { irradiance_.reset(), read_at_ = kNever; }
  // The exposure of a picture, times its tint, with which its white shows what was read last;
  // std::nullopt if nothing was, or it shows too little of the white.
  std::optional<double> exposure_by_white(const PosedPicture& posed) const;
  // The same with which the sky, if it were all as bright as the picture, would light the plane as
  // the white says; std::nullopt if that was not read, or the picture is black.
  std::optional<double> exposure_by_mean(const PictureMean& mean) const;

 private:
  std::optional<LightMeter> meter_;
  double read_at_ = kNever;  // seconds
  std::optional<glm::dvec3> irradiance_;
};

}  // namespace fastibl
