// Tables as terms: one hat-function parameter a node, gauges and smoothness as penalties.
#pragma once

#include "fitter/effects/effect.h"

namespace armtrue {

/// Text of the hat function of node `index` over `nodes` in `variable`. Beyond the ends it falls to
/// zero over the width of the outermost cell, as the firmware's tables do: no correction outside
/// the data. With a single node it is constant.
std::string hat_expression(const std::string& variable, const std::vector<double>& nodes,
                           std::size_t index);

/// Evenly spaced nodes over the values' range, at least `least` of them, no closer than `spacing`.
std::vector<double> nodes_over(const std::vector<double>& values, double spacing,
                               std::size_t least);

/// Penalty on the second difference of three neighbouring nodes, in units of the smoothness chosen
/// from the data.
Penalty curvature_penalty(const std::string& before, const std::string& at,
                          const std::string& after);

/// Penalty that pulls one node towards zero, `sigma` in the same units, so that nodes with few
/// poses do not follow the slope of their neighbours without limit.
Penalty value_penalty(const std::string& parameter, double sigma);

}  // namespace armtrue
