// Contents and order of one session of measurements: time goes forward, an arm takes an hour to
// change its temperature, and a change of payload takes a crane.
#pragma once

#include <vector>

#include "fitter/plan/menu.h"

namespace armtrue {

/// Sessions that a menu allows, each as a mask of its rows: every moment has one temperature, which
/// only rises or only falls with time. A single session of all rows unless both time and
/// temperature are on the menu.
std::vector<std::vector<bool>> sessions(const Menu& menu);

/// Order in which to run rows of one session: time forward and every temperature once, then as few
/// changes of payload as possible, then from each pose to the nearest one left.
std::vector<std::size_t> run_order(const Menu& menu, const Robot& robot,
                                   const std::vector<std::size_t>& rows);

}  // namespace armtrue
