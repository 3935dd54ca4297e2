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
  // For a pass left out: the largest relative error that this makes, where known.
  std::optional<double> bound = 0.0;
  // For an included pass, where known: the picture's error by its method alone (for capture and,
  // where nothing was measured, for irradiance: the error of the irradiance).
  std::optional<double> error = {};
  std::optional<double> milliseconds = {};  // for an included pass: of one run, where known
  bool once = false;                        // it runs when the light has changed, not in each frame
};

struct Plan {
  Methods methods;
  std::vector<PlannedPass> passes;  // all, in the order in which they run
  double error_budget = 0;          // relative; 0: none was asked for
  double milliseconds_budget = 0;
  // Where errors were measured: the error of the whole picture by all methods together, and the
  // least that any of the candidates leave.
  std::optional<double> picture_error = {}, best_error = {};
  // Where errors were measured for one picture: what four samples a pixel leave of it, whatever the
  // methods. It is no part of the budget.
  std::optional<double> sampling_error = {};
  double picture_assured = 0, best_assured = 0;  // what these errors hardly ever exceed
  // Share of the light that is new since errors were measured, where they are to be measured anew.
  double light_unjudged = 0;
  // Whether the parts of a pixel that show triangles of nearly equal normals are shaded as one.
  // These normals differ by a twelfth of the lobe's width at most. That changes the picture by
  // 0.01 % of its light, and one in a hundred of its pixels by 0.2 %. Not within budgets below
  // kLeastForOne.
  bool shades_alike_as_one = false;
  static constexpr double kLeastForOne = 0.005;
  // Milliseconds of a frame by the cost table and the slowdown: of the passes that run in every
  // frame, and of the others their share; in turns, of those and the longest turn.
  double milliseconds = 0;
  // Whether a frame takes only one step of the light's work: a picture into the map, or what is
  // made from the map, which is then some frames old.
  bool light_in_turns = false;
  bool includes(PassId id) const;
  // Against the truth for the same map: picture_error with what new light may add, or else the root
  // of the sum of squares of the known errors.
  double expected_error() const;
  // The error of a captured map's irradiance. It is no part of the budget: no method reduces it.
  std::optional<double> light_error() const;
  // The sum of the bounds of the passes left out; nothing where one of them is not known.
  std::optional<double> omission_bound() const;
  // What the picture's error is not expected to exceed, whatever the view.
  double assured_error() const;
  // Whether the budgets that were asked for hold; true without any.
  bool meets_error() const;
  bool meets_milliseconds() const {
    return milliseconds_budget == 0 || milliseconds <= milliseconds_budget;
  }
  bool meets_budget() const { return meets_error() && meets_milliseconds(); }
  // Errors that new light makes, per share of it: mean, and hardly exceeded. See ./dev goals plan
  // --only "light that is discovered".
  static constexpr double kUnjudged = 0.06, kMostUnjudged = 0.16;
  static constexpr double kAssurance = 1.25;  // factor on the error of the samples' worst view
  // The same for the effect of one step that is left out: views between those have up to twice as
  // much of it, where one lamp makes most of it.
  static constexpr double kOmitted = 2;
};

struct PlanOptions {
  Methods methods = {};
  bool track = true;    // poses come from the back picture, not from outside
  bool capture = true;  // the map comes from pictures, not from outside
  bool cast_shadow = true;
  double error = 0, milliseconds = 0;  // budgets, 0 for none
  const Lighting* lighting = nullptr;  // as fitted to the map, where there is one
  // The errors of candidates() for these methods under the present light, to choose from. Null or
  // empty: steps that are `automatic` stay so.
  const MeasuredErrors* measured = nullptr;
  Costs costs = {};
  Workload workload = {};
  // The parts of the previous picture, where there was one. With a time budget, methods are chosen
  // for them; else they are for the bill alone, so that choices do not depend on them.
  std::optional<PartCounts> object = {};
  double slowdown = 1;  // of this machine now, relative to the cost table
  bool light_in_turns = false;
  double light_lag = 0;       // then, relative change of the light from turn to turn
  double light_unjudged = 0;  // as in Plan
  // Methods of the previous plan. They stay where others are hardly better; settled: in any case.
  const Methods* keep = nullptr;
  bool settled = false;
};

// The candidate options by the scene and its light.
CandidateOptions candidate_options(const Scene& scene, const Environment& environment);

// Throws std::invalid_argument for an error that is no share (0 to 1), or for an invalid time.
void check_budgets(double error, double milliseconds);

// environment may be null: nothing is known of the light yet.
Plan make_plan(const Scene& scene, const Environment* environment, const PlanOptions& options);

// Passes to run now, in order. Staleness spreads forward through all passes, and what is wanted
// spreads backward; a pass runs where both meet. The caller keeps `stale` between frames and adds
// the inputs that changed, what came from outside in place of a pass left out, and, when the plan
// changed, the image and what is now made in another way. What runs, and what came from outside, is
// cleared from it.
std::vector<PassId> due_passes(const Plan& plan, Products wanted, Products& stale);

}  // namespace fastibl
