// A structure in the residual that no effect of the catalogue explains.
#pragma once

#include <string>
#include <vector>

#include "fitter/diagnose/scoring/scorer.h"

namespace armtrue {

/// A nonparametric block: a smooth function of one or two variables on one coordinate.
struct StructureFinding {
  std::vector<std::string> variables;  ///< "q2", "payload" …
  std::vector<int> joints;             ///< joints of the variables and of the coordinate, 1-based
  std::string coordinate;              ///< where it acts: "motor3"
  Block block;
  BlockScore score;
  double log10_p = 0.0;       ///< corrected for the number of blocks tried
  double cost = 0.0;          ///< BIC with it minus without, in its best form
  std::string shape;          ///< in words
  bool has_own_form = false;  ///< its block is weighed as it is, not as a smooth function
  std::size_t nodes = 0;      ///< over its variable, if more than usual; 0: the usual number
  /// 0 if the cause is unknown. For a known cause with a search of its own, such as a knock of the
  /// tracker: how many alternatives that search tried, for example moments of the knock.
  std::size_t tried = 0;
  std::vector<double> x,
      y;  ///< the fitted function over the first variable [rad or m], for drawing
};

}  // namespace armtrue
