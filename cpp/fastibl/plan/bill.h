// A plan as text.
#pragma once

#include <string>

#include "fastibl/plan/plan.h"

namespace fastibl {

// Reads like a bill: pass, method, expected error and time, or why it is left out; then whether the
// budgets are kept.
std::string bill(const Plan& plan);

}  // namespace fastibl
