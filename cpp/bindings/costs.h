// The cost table as Python has it: nanoseconds by name.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "fastibl/core/check.h"
#include "fastibl/plan/costs.h"

namespace fastibl::bindings {

// The given costs; names that are missing keep the built-in ones.
inline Costs costs_from(const std::map<std::string, double>& given) {
  Costs costs;
  for (const auto& [name, value] : given) {
    const auto field = std::find_if(cost_fields().begin(), cost_fields().end(),
                                    [&](const CostField& f) { return f.name == name; });
    check(field != cost_fields().end(), "costs has no \"", name,
          "\"; fastibl.default_costs() has all names");
    check(value >= 0 && std::isfinite(value), "costs[\"", name,
          "\"] must be nanoseconds, at least 0 and finite, got ", value);
    costs.*field->value = value;
  }
  return costs;
}
inline std::map<std::string, double> costs_map(const Costs& costs) {
  std::map<std::string, double> result;
  for (const CostField& field : cost_fields()) result[std::string(field.name)] = costs.*field.value;
  return result;
}

}  // namespace fastibl::bindings
