#include "fastibl/capture/known_cameras.h"

#include <algorithm>

namespace fastibl {
namespace {

// Remembered: those used last. A wide one holds 9 bytes for each pixel of its sides.
constexpr std::size_t kCameras = 16, kWideCameras = 4;
// Exposures that differ by less are one: cameras round them.
constexpr double kSameExposure = 1.5;
// Of the longest to the shortest exposure: cameras that follow the light alone seldom have that.
constexpr double kBracket = 8;

}  // namespace

KnownCamera::KnownCamera(const Camera& camera, int number, int texels)
    : camera_(camera), number_(number) {
  if (camera.model == CameraModel::perspective) {
    sides_.emplace_back(camera);
    return;
  }
  wide_ = sides_of(camera, texels);
  for (const WideSide& side : wide_) sides_.emplace_back(side.camera, side.vignette).of_wide = true;
}

bool KnownCamera::note_exposure(double exposure) {
  shortest_ = std::min(shortest_, exposure), longest_ = std::max(longest_, exposure);
  return exposure <= kSameExposure * shortest_;
}

bool KnownCamera::brackets() const { return longest_ >= kBracket * shortest_; }

KnownCamera& KnownCameras::get(const Camera& camera, int number, int texels) {
  const bool perspective = camera.model == CameraModel::perspective;
  std::vector<KnownCamera>& all = perspective ? perspective_ : wide_;
  ++used_;
  for (KnownCamera& known : all)
    if (known.is(camera, number)) {
      known.used = used_;
      return known;
    }
  camera.validate();
  const std::size_t most = perspective ? kCameras : kWideCameras;
  if (all.size() == most) {  // a zoom makes a new one for each picture
    const auto oldest = std::min_element(
        all.begin(), all.end(),
        [](const KnownCamera& a, const KnownCamera& b) { return a.used < b.used; });
    forgot_assumed_ |= oldest->doubt.assumed();
    all.erase(oldest);
  }
  KnownCamera& known = all.emplace_back(camera, number, texels);
  known.used = used_, known.first = ++known_;
  return known;
}

template <class Is>
bool KnownCameras::any(const Is& is) const {
  return std::any_of(perspective_.begin(), perspective_.end(), is) ||
         std::any_of(wide_.begin(), wide_.end(), is);
}

bool KnownCameras::any_assumed() const {
  return forgot_assumed_ || any([](const KnownCamera& known) { return known.doubt.assumed(); });
}

bool KnownCameras::any_brackets() const {
  return any([](const KnownCamera& known) { return known.brackets(); });
}

}  // namespace fastibl
