// Why a scene does without a pass, and what that may do to its picture. Private to plan.
#pragma once

#include <optional>
#include <string>

#include "fastibl/plan/plan.h"

namespace fastibl {

struct Omission {
  std::string reason;                 // empty: the pass is needed
  std::optional<double> bound = 0.0;  // see PlannedPass
};

// plan: its methods are chosen, and its passes before this one are decided. dispensable: the reason
// for leaving a pass out where a chosen method does without it.
Omission omission_of(PassId id, const Scene& scene, const Environment* environment,
                     const PlanOptions& options, const Plan& plan, const char* dispensable);

// Why the self-shadow cannot, or need not, be worked out from the light; empty where it can.
std::string no_transfer(const Scene& scene);

}  // namespace fastibl
