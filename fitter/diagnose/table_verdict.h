// What of a fit is a table and not physics: what it costs, and what would turn it into physics.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "fitter/evidence/block.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// A table of the fit: a function that the poses were joined up by, which no effect names. It holds
/// where poses lie and says nothing beyond them.
struct TableVerdict {
  std::string effect;
  std::vector<int> joints;
  int nodes = 0;
  double nodes_per_pose = 0.0;
  double waves = 0.0;   ///< share of its variance beyond a line that one and two waves a turn hold
  double cycles = 0.0;  ///< a turn, of the strongest further wave; 0: none stands out
  double cycles_hold = 0.0;  ///< share of the variance that it holds beside them
  std::string next;          ///< what would turn it into physics
};

/// One for each table of the fit, by joint where it is a joint's.
std::vector<TableVerdict> tables_of(const Fit& fit);

/// Whether tables of the fit can take over all terms of a block: each is a straight line over the
/// variable of a table that acts on the same coordinate.
bool is_part_of_tables(const Block& block, const Fit& fit);

nlohmann::json to_json(const std::vector<TableVerdict>& tables);

/// One sentence on all of them; empty without tables.
std::string sentence_of(const std::vector<TableVerdict>& tables);

}  // namespace armtrue
