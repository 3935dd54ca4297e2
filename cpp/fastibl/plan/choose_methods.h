// The cheapest methods within the error budget, or the best within the time budget.
#pragma once

#include "fastibl/plan/candidates.h"
#include "fastibl/plan/costs.h"

namespace fastibl {

struct ChoiceOptions {
  double error = 0, milliseconds = 0;  // budgets, 0 for none
  double assurance = 1;                // that errors are multiplied with before they are compared
  double slowdown = 1;                 // and times
  double other_milliseconds = 0;       // and of passes that run whatever is chosen
  // What is used now: it stays where it is in the same way within the budgets, and within a fifth
  // of the best that could be had. Null: nothing is.
  const Methods* keep = nullptr;
  bool settled = false;                      // it stays in any case
  bool transfer = true, cast_shadow = true;  // whether these passes run at all
};
struct Choice {
  Methods methods;
  Combination at;  // of the candidates
  // Of the picture: expected, and what it is hardly ever beyond; the least that any combination
  // has.
  double error = 0, assured = 0, best_error = 0, best_assured = 0;
  double milliseconds = 0;  // of a frame, without other_milliseconds
};

// Of all combinations: within both budgets the cheapest. Where none is within the error budget,
// the cheapest of those within a tenth of the best; where none is within the time budget, the best
// of those that are, or else the cheapest of all. Without an error budget the best within the time
// budget. The rest of `asked` stays as it is.
Choice choose_methods(const Methods& asked, const MeasuredErrors& errors, const Costs& costs,
                      const Workload& workload, const ChoiceOptions& options);

}  // namespace fastibl
