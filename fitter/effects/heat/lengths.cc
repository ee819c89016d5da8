#include "fitter/effects/heat/lengths.h"

#include <cmath>

namespace armtrue {

Parameter grown_lengths(const Robot& robot, const std::string& effect,
                        const std::vector<int>& joints, const std::string& suffix,
                        const std::string& unit, double bound, const std::vector<int>& links,
                        const std::string& growth) {
  Parameter p;
  p.name = parameter_name(effect, joints, suffix);
  p.effect = effect;
  p.joints = joints;
  p.unit = unit;
  p.bound = bound;
  p.prior_sigma = 3.0 * bound;
  for (const int link : links) {
    const Eigen::Vector3d length = nominal_lengths(robot, link);
    for (int c = 0; c < 3; ++c) {
      if (std::abs(length[c]) < 1e-9) continue;
      const Coordinate place = link == 0 ? on_base(c) : on_link(link, c);
      p.terms.push_back(Term{place, Expression::parse(growth), length[c], std::nullopt});
    }
  }
  return p;
}

std::vector<int> links_of_joint(int joint) {
  return joint == 1 ? std::vector<int>{0, 1} : std::vector<int>{joint};
}

}  // namespace armtrue
