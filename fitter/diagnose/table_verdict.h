// Tables of a fit, which are not physics: what they cost, and how to replace them by physics.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fitter/evidence/block.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// A table of the fit: a function interpolated between the poses, which no effect explains. It
/// holds only where poses lie.
struct TableVerdict {
  std::string effect;
  std::vector<int> joints;
  int nodes = 0;
  double nodes_per_pose = 0.0;
  double waves = 0.0;   ///< share of its variance beyond a line that 1 and 2 waves a turn explain
  double cycles = 0.0;  ///< per turn, of the strongest further wave; 0: none stands out
  double cycles_hold = 0.0;  ///< share of the variance that this wave explains in addition
  std::string next;          ///< how to replace it by physics
};

/// One for each table of the fit; joints have separate tables.
std::vector<TableVerdict> tables_of(const Fit& fit);

/// Whether tables of the fit can reproduce all terms of a block: each term is a straight line over
/// the variable of a table on the same coordinate.
bool is_part_of_tables(const Block& block, const Fit& fit);

nlohmann::json to_json(const std::vector<TableVerdict>& tables);

/// One sentence on all of them; empty without tables.
std::string sentence_of(const std::vector<TableVerdict>& tables);

}  // namespace armtrue
