// What one session of measurements can hold, and in which order it is run: time goes forward, an
// arm takes an hour to change its temperature, and a payload takes a crane.
#pragma once

#include <vector>

#include "fitter/plan/menu.h"

namespace armtrue {

/// Sessions that a menu allows, each as a mask of its rows: every moment has one temperature, which
/// only rises or only falls as time goes forward. One of all rows where not both time and
/// temperature are on the menu.
std::vector<std::vector<bool>> sessions(const Menu& menu);

/// Order in which to run rows of one session: time forward and every temperature once, payloads
/// changed as seldom as can be then, and from pose to pose to the nearest that is left.
std::vector<std::size_t> run_order(const Menu& menu, const Robot& robot,
                                   const std::vector<std::size_t>& rows);

}  // namespace armtrue
