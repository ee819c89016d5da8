// Links that grow: one coefficient times the nominal lengths, for any cause of growth.
#pragma once

#include "fitter/effects/effect.h"

namespace armtrue {

/// A parameter that adds coefficient × `growth` × nominal length on tx ty tz of the given links (0
/// = base).
Parameter grown_lengths(const Robot& robot, const std::string& effect,
                        const std::vector<int>& joints, const std::string& suffix,
                        const std::string& unit, double bound, const std::vector<int>& links,
                        const std::string& growth);

/// Links whose length belongs to joint k: that from frame k on, and for joint 1 also the base's.
std::vector<int> links_of_joint(int joint);

}  // namespace armtrue
