// Chooses the cheapest methods within the error budget, or the best within the time budget.
#pragma once

#include "fastibl/plan/candidates.h"
#include "fastibl/plan/costs.h"

namespace fastibl {

struct ChoiceOptions {
  double error = 0, milliseconds = 0;  // budgets, 0 for none
  double assurance = 1;                // factor on errors before they are compared
  double slowdown = 1;                 // likewise, factor on times
  double other_milliseconds = 0;       // of the passes that run whatever is chosen
  // The methods in use. They stay where they keep to the budgets in the same way as the best ones,
  // and the best ones are no more than a fifth better. Null: none are in use.
  const Methods* keep = nullptr;
  bool settled = false;                      // `keep` stays in any case
  bool transfer = true, cast_shadow = true;  // whether these passes run at all
};
struct Choice {
  Methods methods;
  Combination at;  // of the candidates
  // The picture's error: expected, and what it hardly ever exceeds; best_…: the least of any
  // combination.
  double error = 0, assured = 0, best_error = 0, best_assured = 0;
  double milliseconds = 0;  // of a frame, without other_milliseconds
};

// Of all combinations, chooses the cheapest within both budgets. Where none is within the error
// budget, it is the cheapest of those within a tenth of the best. Where none of these is within the
// time budget, it is the best of those that are or, failing that, the cheapest of all. Without an
// error budget, it is the best within the time budget. The rest of `asked` stays as it is.
Choice choose_methods(const Methods& asked, const MeasuredErrors& errors, const Costs& costs,
                      const Workload& workload, const ChoiceOptions& options);

}  // namespace fastibl
