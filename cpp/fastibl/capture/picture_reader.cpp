#include "fastibl/capture/picture_reader.h"

#include <algorithm>

#include "fastibl/capture/footprint.h"

namespace fastibl {
namespace {

constexpr double kRimOfLight = 0.25;    // of a light's radiance: reached at its rim
constexpr double kLargestScale = 1e30;  // of linear values: no exposure is so short

}  // namespace

// What the tint's channels have in common is exposure, to the noise of the sensor as well.
PictureReader::PictureReader(const PosedPicture& posed, const Taken& taken, double bright,
                             const Surroundings& surroundings, const FrameLevels& levels)
    : posed_(posed),
      surroundings_(surroundings),
      levels_(levels),
      hidden_(discs_of(surroundings.lights(), posed)),
      scale_(std::min(1 / (taken.exposure * taken.grey_tint() * posed.side.camera.gain),
                      kLargestScale)),
      light_(float(kRimOfLight * bright / scale_)),
      untint_(taken.grey_tint() / taken.tint) {}

bool PictureReader::read(const Depth& depth, int count, bool fine, Sightings& sightings,
                         Samples& samples) const {
  if (!posed_.mask.empty()) leave_out_masked(count, sightings);
  if (surroundings_.is_usual(depth)) leave_out_hidden(count, sightings);
  const bool rim = sample_footprints(levels_, sightings, count, light_, fine, samples);
  if (untint_ != glm::vec3(1)) remove_tint(count, samples);
  scale_to_radiance(count, sightings, samples);
  return rim;
}

void PictureReader::leave_out_masked(int count, Sightings& sightings) const {
  for (int i = 0; i < count; ++i)
    if (sightings.seen[i])
      sightings.seen[i] = posed_.shows(int(sightings.x[i]), int(sightings.y[i]));
  if (posed_.hidden.empty()) return;
  for (int i = 0; i < count; ++i) {
    if (!sightings.seen[i]) continue;
    const PixelBox box = footprint_box(sightings.x[i], sightings.y[i], sightings.pixels[i]);
    sightings.seen[i] = !posed_.hidden.hides_any(box.x0, box.y0, box.x1, box.y1);
  }
}

void PictureReader::leave_out_hidden(int count, Sightings& sightings) const {
  for (const Disc& disc : hidden_)
    for (int i = 0; i < lanes_of(count); ++i) {
      const float x = sightings.x[i] - disc.x, y = sightings.y[i] - disc.y;
      sightings.seen[i] &= !(x * x + y * y < disc.squared_radius);
    }
}

void PictureReader::remove_tint(int count, Samples& samples) const {
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < lanes_of(count); ++i) {
      samples.linear[c][i] *= untint_[c];
      if (samples.fine) samples.spread[c][i] *= untint_[c];
    }
}

void PictureReader::scale_to_radiance(int count, const Sightings& sightings,
                                      Samples& samples) const {
  const CameraSide& side = posed_.side;
  if (!side.vignettes()) {
    std::fill_n(samples.radiance_per_linear, lanes_of(count), scale());
    return;
  }
  for (int i = 0; i < lanes_of(count); ++i)
    samples.radiance_per_linear[i] =
        sightings.seen[i] ? float(scale_ / side.vignette(sightings.x[i], sightings.y[i])) : 1.0f;
}

}  // namespace fastibl
