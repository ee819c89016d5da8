// What can be commanded in a campaign: joints, and beside them payloads, directions of approach,
// temperatures and moments, as far as a model reads them.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "fitter/design/model.h"
#include "fitter/plan/cell.h"

namespace armtrue {

/// Values that a column may be given, by the column's name.
using Levels = std::map<std::string, std::vector<double>>;

/// Possible measurements, row by row.
struct Menu {
  State::Columns columns;
  std::vector<std::string> written;  ///< columns for whoever runs the plan, in order
  std::size_t uniform = 0;  ///< the first so many rows are spread evenly: the arm's reachable set
};

/// Recorded columns that the terms of a model read and that somebody can set: payload, dir…,
/// temp_…, time and what custom expressions name. Joints are not among them.
std::set<std::string> settable_columns(const Model& model, const State& state);

/// Levels of columns as they were recorded: all values of a few, low, middle and high of many, both
/// directions.
Levels recorded_levels(const State& state, const std::set<std::string>& columns);

/// Half of `count` rows evenly over the reachable poses, half with joints at the ends of their
/// ranges, each with levels drawn at random. Columns qr… follow the joints.
Menu make_menu(const Robot& robot, const Pose& flange_from_tool, const Cell& cell,
               const Eigen::MatrixX2d& ranges, const Levels& levels, std::size_t count,
               std::uint64_t seed);

}  // namespace armtrue
