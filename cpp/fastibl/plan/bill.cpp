#include "fastibl/plan/bill.h"

#include <cmath>
#include <cstdio>
#include <optional>
#include <sstream>

namespace fastibl {

std::string bill(const Plan& plan) {
  std::ostringstream text;
  const auto number = [](double value, const char* unit) {
    char buffer[48];
    std::snprintf(buffer, sizeof buffer, "%.2g %s", value, unit);
    return std::string(buffer);
  };
  const auto percent = [&](double value) { return number(100 * value, "%"); };
  const auto milliseconds = [](double value) {
    char buffer[48];
    std::snprintf(buffer, sizeof buffer, "%.2f ms", value);
    return std::string(buffer);
  };
  const auto column = [&](const std::string& value, std::size_t width) {
    text << value << std::string(value.size() < width ? width - value.size() : 1, ' ');
  };
  column("pass", 12), column("method", 40), column("expected error", 16), text << "expected time\n";
  for (const PlannedPass& p : plan.passes) {
    column(std::string(name(p.pass.id)), 12);
    if (p.included) {
      column(p.method.empty() ? "-" : p.method, 40);
      column(p.error ? percent(*p.error) : "-", 16);
      text << (p.milliseconds ? milliseconds(*p.milliseconds) : "-") << (p.once ? " once\n" : "\n");
    } else {
      column("left out", 40);
      text << (p.bound ? "at most " + percent(*p.bound) : "not known by how much") << ": "
           << p.reason << "\n";
    }
  }
  column("in all", 52);
  if (plan.picture_error) {
    column(percent(plan.expected_error()), 16);
    text << milliseconds(plan.milliseconds) << " a frame\nthe picture is within "
         << percent(plan.assured_error());
    if (plan.light_unjudged > 0)
      text << "; " << percent(plan.light_unjudged) << " of the light is new since that was judged";
  } else {
    const std::optional<double> bound = plan.omission_bound();
    text << percent(plan.expected_error()) << " known, "
         << (bound ? percent(*bound) + " at most" : "not known how much")
         << " from what is left out";
  }
  if (plan.error_budget > 0 && !plan.picture_error && plan.expected_error() <= plan.error_budget) {
    text << "\nnot judged yet, nor whether it is within the error budget of "
         << percent(plan.error_budget);
  } else if (plan.error_budget > 0) {
    text << (plan.meets_error() ? "\nwithin" : "\nNOT within") << " the error budget of "
         << percent(plan.error_budget);
    if (!plan.meets_error() && plan.best_error)
      text << ": the best methods leave " << percent(*plan.best_error) << ", within "
           << percent(plan.best_assured);
  }
  if (const auto light = plan.light_error(); light && std::isfinite(*light))
    text << "\nthe captured light is expected to be off by " << percent(*light)
         << ", whatever the methods";
  if (plan.sampling_error)
    text << "\nfour samples a pixel leave " << percent(*plan.sampling_error)
         << ", whatever the methods; supersampling draws more";
  if (plan.light_in_turns)
    text << "\nthe light is made in turns, one step a frame: some frames late";
  if (plan.milliseconds_budget > 0)
    text << (plan.meets_milliseconds() ? "\nwithin" : "\nNOT within") << " the time budget of "
         << milliseconds(plan.milliseconds_budget);
  return text.str();
}

}  // namespace fastibl
