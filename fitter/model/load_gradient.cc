#include "fitter/model/load_gradient.h"

namespace armtrue {

LoadGradient::LoadGradient(const Robot& robot, const CoordinateLayout& layout, const Pose* frames,
                           double payload)
    : robot_(robot), layout_(layout), frames_(frames) {
  const auto n = static_cast<std::size_t>(layout.joints);
  mass_.assign(n + 1, payload);
  moment_.assign(n + 1, payload * frames[n].translation());
  for (std::size_t k = n; k-- > 0;) {
    const Link& link = robot.links[k];
    mass_[k] = mass_[k + 1] + link.mass;
    moment_[k] = moment_[k + 1] + link.mass * (frames[k] * link.com_in_frame);
  }
}

// A screw before the frame turns it and its masses together, as if gravity turned the other way; a
// screw behind it shifts the mass moment of what it moves. `frame` -1: the robot base.
double LoadGradient::change(int frame, const Eigen::Vector3d& axis, bool slides,
                            const Screw& by) const {
  const Eigen::Vector3d& g = robot_.gravity;
  const auto body = static_cast<std::size_t>(std::max(frame, 0));
  if (frame >= 0 && by.moves <= frame) {
    if (by.slides) return 0.0;
    const Eigen::Vector3d turned = g.cross(by.axis);
    if (slides) return mass_[body] * axis.dot(turned);
    return axis.dot((moment_[body] - mass_[body] * frames_[body].translation()).cross(turned));
  }
  if (slides) return 0.0;
  const auto first = static_cast<std::size_t>(by.carries);
  const Eigen::Vector3d shift = by.slides ? Eigen::Vector3d(mass_[first] * by.axis)
                                          : by.axis.cross(moment_[first] - mass_[first] * by.point);
  return axis.dot(shift.cross(g));
}

void LoadGradient::add(int frame, const Eigen::Vector3d& axis, bool slides, double factor,
                       Eigen::Ref<Eigen::RowVectorXd> gradient) const {
  const auto virtual_joint = [&](const Pose& at, int moves, int first) {
    for (int c = 0; c < 6; ++c) {
      const Screw screw{at.linear().col(c % 3), at.translation(), c < 3, moves, moves};
      gradient[first + c] += factor * change(frame, axis, slides, screw);
    }
  };
  virtual_joint(Pose::Identity(), 0, layout_.base(0));
  for (int k = 0; k < layout_.joints; ++k) {
    const Pose& at = frames_[k];
    const bool prismatic = robot_.joints[static_cast<std::size_t>(k)].prismatic;
    const double turned =
        change(frame, axis, slides, {at.linear().col(2), at.translation(), prismatic, k, k});
    for (int j = 0; j < layout_.joints; ++j)
      gradient[layout_.motor(j)] += factor * robot_.coupling(k, j) * turned;
    virtual_joint(at, k + 1, layout_.link(k, 0));
  }
}

void LoadGradient::of(const Variable& load, Eigen::Ref<Eigen::RowVectorXd> gradient) const {
  gradient.setZero();
  if (load.kind == VariableKind::kBaseMoment) {
    add(-1, Eigen::Vector3d::Unit(load.axis), false, 1.0, gradient);
    return;
  }
  if (load.kind == VariableKind::kMoment) {
    add(load.joint - 1, frames_[load.joint - 1].linear().col(load.axis), false, 1.0, gradient);
    return;
  }
  for (int k = 0; k < layout_.joints; ++k) {
    const double c = robot_.coupling(k, load.joint - 1);
    if (c == 0.0) continue;
    add(k, frames_[k].linear().col(2), robot_.joints[static_cast<std::size_t>(k)].prismatic, c,
        gradient);
  }
}

}  // namespace armtrue
