// Which steps a frame needs, which it does not, and why.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fastibl/plan/candidates.h"
#include "fastibl/plan/costs.h"
#include "fastibl/plan/pass.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/scene.h"

namespace fastibl {

// One line of the plan.
struct PlannedPass {
  Pass pass;
  bool included = true;
  std::string method = {};  // where there is a choice
  std::string reason = {};  // why a pass was left out
  // Of a pass left out: largest relative error that this makes, where known.
  std::optional<double> bound = 0.0;
  // Of an included pass, where known: what its method alone leaves wrong of the picture (of capture
  // and, where nothing was measured, of irradiance: of the irradiance).
  std::optional<double> error = {};
  std::optional<double> milliseconds = {};  // of an included pass: of one run, where known
  bool once = false;                        // it runs when the light has changed, not in each frame
};

struct Plan {
  Methods methods;
  std::vector<PlannedPass> passes;  // all, in the order in which they run
  double error_budget = 0;          // relative; 0: none was asked for
  double milliseconds_budget = 0;
  // Where errors were measured: of the whole picture, all methods together, and the least that any
  // of the candidates leave.
  std::optional<double> picture_error = {}, best_error = {};
  double picture_assured = 0, best_assured = 0;  // the same that errors are hardly ever beyond
  // Whether what triangles of hardly different normals show of one pixel is shaded as one. Those
  // differ by a twelfth of the lobe's width at most: the picture by 0.01 % of its light, and of its
  // pixels one in a hundred by 0.2 %. Not within budgets below kLeastForOne.
  bool shades_alike_as_one = false;
  static constexpr double kLeastForOne = 0.005;
  // Of a frame, by the cost table and the slowdown, of the passes that run in every one; in turns,
  // of those and the longest turn.
  double milliseconds = 0;
  // Whether a frame takes one step of the light's work: a picture into the map, or what is made of
  // it, which then is some frames old.
  bool light_in_turns = false;
  bool includes(PassId id) const;
  // Against the truth of the same map: picture_error, else the root of the sum of squares of the
  // known ones.
  double expected_error() const;
  // That of a captured map's irradiance, which is no part of the budget: no method makes it less.
  std::optional<double> light_error() const;
  // Sum over the passes left out; nothing where that of one of them is not known.
  std::optional<double> omission_bound() const;
  // What the picture's error is not expected to exceed, whatever the view.
  double assured_error() const;
  // Whether the budgets that were asked for hold; true without any.
  bool meets_error() const;
  bool meets_milliseconds() const {
    return milliseconds_budget == 0 || milliseconds <= milliseconds_budget;
  }
  bool meets_budget() const { return meets_error() && meets_milliseconds(); }
  static constexpr double kAssurance = 1.25;  // times what the worst of the samples' views has
  // The same of what one step does that is left out: views between those have up to twice as much,
  // where one lamp makes most of it.
  static constexpr double kOmitted = 2;
};

struct PlanOptions {
  Methods methods = {};
  bool track = true;    // poses come from the back picture, not from outside
  bool capture = true;  // the map comes from pictures, not from outside
  bool cast_shadow = true;
  double error = 0, milliseconds = 0;  // budgets, 0 for none
  const Lighting* lighting = nullptr;  // as fitted to the map, where there is one
  // Of candidates() for these methods under the light that there is: what is chosen from. Null or
  // empty: steps that are `automatic` stay so.
  const MeasuredErrors* measured = nullptr;
  Costs costs = {};
  Workload workload = {};
  // Pixels of the object in the picture before, where there was one. Within `milliseconds` methods
  // are chosen for them; else they are for the bill alone, so that choices do not depend on them.
  std::optional<double> object_pixels = {};
  double slowdown = 1;  // of this machine, now, by the cost table
  bool light_in_turns = false;
  double light_lag = 0;  // then, of the light: by what it is old
  // Methods of the plan before, which stay where others are hardly better; settled: in any case.
  const Methods* keep = nullptr;
  bool settled = false;
};

// What the scene and its light tell of them.
CandidateOptions candidate_options(const Scene& scene, const Environment& environment);

// Throws std::invalid_argument for an error that is no share, or a time that is none.
void check_budgets(double error, double milliseconds);

// environment may be null: nothing is known of the light yet.
Plan make_plan(const Scene& scene, const Environment* environment, const PlanOptions& options);

// Passes to run now, in order. Staleness spreads forward through all passes, what is wanted spreads
// backward; a pass runs where both meet. `stale` is kept between frames by the caller, who adds the
// inputs that changed, what came from outside in place of a pass left out, and, when the plan
// changed, the image and what is made otherwise; what runs, and what came from outside, are cleared
// from it.
std::vector<PassId> due_passes(const Plan& plan, Products wanted, Products& stale);

}  // namespace fastibl
