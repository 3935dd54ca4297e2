// Which steps a frame needs, which it does not, and why.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "fastibl/scene/environment.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

// What passes read and write, as bits. The first row comes from outside.
using Products = std::uint32_t;
namespace product {
inline constexpr Products back_picture = 1, light_pictures = 2, placement = 4, material = 8;
inline constexpr Products pose = 16, texels = 32, radiance = 64, irradiance = 128, shadow = 256,
                          object = 512, image = 1024, self_shadow = 2048, bounce = 4096,
                          plane = 8192, holdout = 16384, near_light = 32768;
inline constexpr Products inputs = 15, all = 65535;
}  // namespace product

enum class PassId {
  track,
  capture,
  mips,
  irradiance,
  shadow,
  self_shadow,
  near_light,  // the object's light by where its parts are, not only by how they are turned
  bounce,
  plane,    // what the plane's picture is multiplied by, where that is not the shadow as it is
  holdout,  // the shadow on real objects
  shade,
  composite
};
inline constexpr std::array kPasses = {PassId::track,      PassId::capture, PassId::mips,
                                       PassId::irradiance, PassId::shadow,  PassId::self_shadow,
                                       PassId::near_light, PassId::bounce,  PassId::plane,
                                       PassId::holdout,    PassId::shade,   PassId::composite};
std::string_view name(PassId id);

struct Pass {
  PassId id;
  Products reads;  // a change of these makes what it writes stale
  Products
      needs;  // must be fresh before it runs, but do not make it run: pictures bring their own pose
  Products writes;
};

// One line of the plan.
struct PlannedPass {
  Pass pass;
  bool included;
  std::string method;           // of an included pass, where there is a choice
  std::string reason;           // why a pass was left out
  double bound = 0;             // of a pass left out: largest relative error that this makes
  std::optional<double> error;  // of an included pass: expected relative error, where known
};

struct Plan {
  Methods methods;
  std::vector<PlannedPass> passes;  // all, in the order in which they run
  double error_budget = 0;          // relative; 0: none was asked for
  double milliseconds_budget = 0;
  bool includes(PassId id) const;
  double expected_error() const;  // root of the sum of squares of the known ones
  double omission_bound() const;  // sum over the passes left out
};

struct PlanOptions {
  Methods methods;
  bool track = true;    // poses come from the back picture, not from outside
  bool capture = true;  // the map comes from pictures, not from outside
  bool cast_shadow = true;
  double error = 0, milliseconds = 0;  // budgets, 0 for none
  const Lighting* lighting = nullptr;  // as fitted to the map, where there is one
};

// environment may be null: nothing is known of the light yet.
Plan make_plan(const Scene& scene, const Environment* environment, const PlanOptions& options);

// Passes to run now, in order. Staleness spreads forward through all passes, what is wanted spreads
// backward; a pass runs where both meet. `stale` is kept between frames by the caller, who adds the
// inputs that changed, what came from outside in place of a pass left out, and, when the plan
// changed, the image and what is made otherwise; what runs, and what came from outside, are cleared
// from it.
std::vector<PassId> due_passes(const Plan& plan, Products wanted, Products& stale);

}  // namespace fastibl
