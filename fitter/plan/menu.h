// Quantities that can be set in a campaign: joints and, if a model reads them, payloads, directions
// of approach, temperatures and times.
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
  std::vector<std::string> written;  ///< columns of the plan that its operator needs, in order
  std::size_t uniform = 0;  ///< number of first rows, spread evenly over the arm's reachable set
};

/// Recorded columns that the terms of a model read and an operator can set: payload, dir…, temp_…,
/// time and columns of custom expressions. Joints are not among them.
std::set<std::string> settable_columns(const Model& model, const State& state);

/// Levels of columns as recorded: all values if they are few, else lowest, median and highest; both
/// directions.
Levels recorded_levels(const State& state, const std::set<std::string>& columns);

/// Half of `count` rows spread evenly over the reachable poses, half with joints at the ends of
/// their ranges, each with levels drawn at random. Columns qr… are copies of the joints.
Menu make_menu(const Robot& robot, const Pose& flange_from_tool, const Cell& cell,
               const Eigen::MatrixX2d& ranges, const Levels& levels, std::size_t count,
               std::uint64_t seed);

/// Sessions that a menu allows, each as a mask of its rows: time goes forward, and an arm takes an
/// hour to change its temperature, so every moment has one temperature, which only rises or only
/// falls with time. A single session of all rows unless both time and temperature are on the menu.
std::vector<std::vector<bool>> sessions(const Menu& menu);

/// Order in which to run the rows of one session. Time goes forward and every temperature comes
/// once. Between rows of one time and temperature the payload is changed as rarely as possible, as
/// that takes a crane. Of rows with the same payload, each is followed by the nearest pose left.
std::vector<std::size_t> run_order(const Menu& menu, const Robot& robot,
                                   const std::vector<std::size_t>& rows);

}  // namespace armtrue
