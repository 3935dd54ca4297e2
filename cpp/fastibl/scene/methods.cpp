#include "fastibl/scene/methods.h"

#include "fastibl/core/check.h"
#include "fastibl/scene/sampled_lobe.h"

namespace fastibl {

namespace checks {

void no_such_method(std::string_view step, std::string_view text, std::string_view all) {
  invalid("no ", step, " method \"", text, "\"; there are: ", all);
}

void no_such_setting(std::string_view method, std::string_view setting, std::string_view all) {
  invalid(method, " has no setting \"", setting, "\"; there are: ", all.empty() ? "none" : all);
}

void in_range(std::string_view method, std::string_view setting, int least, int most, int value) {
  check(value >= least && value <= most, "setting ", setting, " of ", method, " must be from ",
        least, " to ", most, ", got ", value);
}

}  // namespace checks

std::string_view name(DiffuseMethod method) {
  switch (method) {
    case DiffuseMethod::automatic:
      return "auto";
    case DiffuseMethod::nearest_face:
      return "nearest-face";
    case DiffuseMethod::six_face:
      return "six-face";
    case DiffuseMethod::six_face_exact:
      return "six-face-exact";
    case DiffuseMethod::sh9:
      return "sh9";
    case DiffuseMethod::sh9_lobes:
      return "sh9-lobes";
    default:
      return "irradiance-cube";
  }
}
std::string_view name(GlossyMethod method) {
  switch (method) {
    case GlossyMethod::automatic:
      return "auto";
    case GlossyMethod::centroid:
      return "centroid";
    case GlossyMethod::stretched:
      return "stretched";
    case GlossyMethod::sampled:
      return "sampled";
    case GlossyMethod::prefiltered:
      return "prefiltered";
    default:
      return "mip";
  }
}
std::string_view name(Normalization n) {
  return n == Normalization::energy ? "energy" : n == Normalization::paper ? "paper" : "exact";
}
std::string_view name(ShadowMethod method) {
  switch (method) {
    case ShadowMethod::automatic:
      return "auto";
    case ShadowMethod::cap_sum:
      return "cap-sum";
    case ShadowMethod::cap_product:
      return "cap-product";
    case ShadowMethod::mesh:
      return "mesh";
    default:
      return "directions";
  }
}
std::string_view name(SelfShadowMethod method) {
  switch (method) {
    case SelfShadowMethod::automatic:
      return "auto";
    case SelfShadowMethod::none:
      return "none";
    case SelfShadowMethod::ambient:
      return "ambient-occlusion";
    case SelfShadowMethod::pixel_transfer:
      return "pixel-transfer";
    case SelfShadowMethod::traced_lights:
      return "traced-lights";
    case SelfShadowMethod::traced:
      return "traced";
    default:
      return "transfer";
  }
}
std::string_view name(BounceMethod method) {
  return method == BounceMethod::automatic ? "auto"
         : method == BounceMethod::none    ? "none"
                                           : "one-bounce";
}
std::string_view name(TrackingMethod method) {
  switch (method) {
    case TrackingMethod::automatic:
      return "auto";
    case TrackingMethod::frame_marker:
      return "frame-marker";
    case TrackingMethod::board:
      return "board";
    default:
      return "edges";
  }
}
std::string_view name(CaptureMethod method) {
  return method == CaptureMethod::single ? "single" : "continuous";
}

DiffuseMethod diffuse_method(std::string_view text) {
  if (text == "auto") return DiffuseMethod::automatic;
  return method_named(text, kDiffuseMethods, "diffuse");
}
GlossyMethod glossy_method(std::string_view text) {
  if (text == "auto") return GlossyMethod::automatic;
  return method_named(text, kGlossyMethods, "glossy");
}
Normalization normalization(std::string_view text) {
  return method_named(text, kNormalizations, "normalization");
}
ShadowMethod shadow_method(std::string_view text) {
  if (text == "auto") return ShadowMethod::automatic;
  return method_named(text, kShadowMethods, "shadow");
}
SelfShadowMethod self_shadow_method(std::string_view text) {
  if (text == "auto") return SelfShadowMethod::automatic;
  return method_named(text, kSelfShadowMethods, "self_shadow");
}
BounceMethod bounce_method(std::string_view text) {
  if (text == "auto") return BounceMethod::automatic;
  return method_named(text, kBounceMethods, "bounce");
}
TrackingMethod tracking_method(std::string_view text) {
  if (text == "auto") return TrackingMethod::automatic;
  return method_named(text, kTrackingMethods, "tracking");
}
CaptureMethod capture_method(std::string_view text) {
  return method_named(text, kCaptureMethods, "capture");
}

std::vector<Setting<DiffuseSettings>> settings_of(DiffuseMethod method) {
  if (method == DiffuseMethod::sh9_lobes)
    return {{"lobes", &DiffuseSettings::lobes, 0, 12, {1, 2, 3, 4, 6, 8, 12}}};
  if (method == DiffuseMethod::irradiance_cube)
    return {{"size", &DiffuseSettings::size, 1, 256, {8, 32}},
            {"source", &DiffuseSettings::source, 1, 256, {16}}};
  return {};
}
std::vector<Setting<GlossySettings>> settings_of(GlossyMethod method) {
  const Setting<GlossySettings> lights{"lights", &GlossySettings::lights, 0, 8, {0}};
  if (method == GlossyMethod::centroid) return {lights};
  if (method == GlossyMethod::stretched)
    return {{"taps", &GlossySettings::taps, 2, 4, {2, 4}}, lights};
  if (method == GlossyMethod::sampled)
    return {{"taps", &GlossySettings::taps, 1, kMaxSampledTaps, {4, 16, 256}}};
  if (method == GlossyMethod::prefiltered) return {{"taps", &GlossySettings::taps, 1, 4, {1}}};
  return {};
}
std::vector<Setting<ShadowSettings>> settings_of(ShadowMethod method) {
  if (method == ShadowMethod::mesh) return {{"fine", &ShadowSettings::fine, 0, 2048, {512}}};
  if (method != ShadowMethod::directions) return {};
  return {{"directions",
           &ShadowSettings::directions,
           kLeastDirections,
           kMostDirections,
           {16, 64, 1024}}};
}
std::vector<DiffuseMethod> stands_for(DiffuseMethod method) {
  if (method != DiffuseMethod::automatic) return {method};
  return {DiffuseMethod::sh9_lobes, DiffuseMethod::irradiance_cube};
}
std::vector<GlossyMethod> stands_for(GlossyMethod method) {
  return {method == GlossyMethod::automatic ? GlossyMethod::centroid : method};
}
std::vector<ShadowMethod> stands_for(ShadowMethod method) {
  if (method != ShadowMethod::automatic) return {method};
  return {ShadowMethod::mesh, ShadowMethod::directions};
}

}  // namespace fastibl
