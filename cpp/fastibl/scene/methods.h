// The named methods that a frame is made with, one of each step.
#pragma once

#include <array>
#include <limits>
#include <string>
#include <string_view>

#include "fastibl/core/check.h"
#include "fastibl/scene/lighting.h"

namespace fastibl {

enum class ShadowMethod {
  cap_sum,      // obstruction of all spheres added, and clamped
  cap_product,  // the product of what each sphere lets through
};
enum class TrackingMethod {
  frame_marker,  // the corners of one tag, as the paper's
  board,         // robust refinement over all tags of the board
};
inline constexpr std::array kShadowMethods = {ShadowMethod::cap_sum, ShadowMethod::cap_product};
inline constexpr std::array kTrackingMethods = {TrackingMethod::frame_marker,
                                                TrackingMethod::board};
std::string_view name(ShadowMethod method);
std::string_view name(TrackingMethod method);
ShadowMethod shadow_method(
    std::string_view name);  // throw std::invalid_argument, naming all methods
TrackingMethod tracking_method(std::string_view name);

// Which camera pictures feed the map.
enum class CaptureMethod {
  single,      // the paper's: one front picture of one exposure every five seconds
  continuous,  // every picture of both cameras, all exposures merged
};
inline constexpr std::array kCaptureMethods = {CaptureMethod::single, CaptureMethod::continuous};
std::string_view name(CaptureMethod method);
CaptureMethod capture_method(std::string_view name);

struct Methods {
  TrackingMethod tracking = TrackingMethod::board;
  CaptureMethod capture = CaptureMethod::continuous;
  DiffuseMethod diffuse = DiffuseMethod::sh9;
  GlossyMethod glossy = GlossyMethod::mip;
  Normalization normalization = Normalization::energy;
  ShadowMethod shadow = ShadowMethod::cap_product;

  static Methods paper() {
    return {TrackingMethod::frame_marker, CaptureMethod::single,
            DiffuseMethod::six_face,      GlossyMethod::mip,
            Normalization::paper,         ShadowMethod::cap_product};
  }
  bool operator==(const Methods&) const = default;
};

// The method of that name among `methods`; throws std::invalid_argument, naming all.
template <typename Method, std::size_t N>
Method method_named(std::string_view text, const std::array<Method, N>& methods, const char* step) {
  std::string all;
  for (const Method method : methods) {
    if (name(method) == text) return method;
    all += (all.empty() ? "" : ", ") + std::string(name(method));
  }
  check(false, "no ", step, " method \"", text, "\"; there are: ", all);
  return methods[0];
}

}  // namespace fastibl
