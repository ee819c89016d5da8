// Derivatives of gravity's loads by the arm's coordinates.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/model/coordinate.h"
#include "fitter/model/robot.h"
#include "fitter/model/variable.h"

namespace armtrue {

/// Derivatives of torques and moments of gravity by all coordinates of the chain at one pose. The
/// virtual joints are near zero, so that their axes are those of their frames.
class LoadGradient {
 public:
  /// `frames`: 1…n in the robot base, then the payload point's; `payload` [kg].
  LoadGradient(const Robot& robot, const CoordinateLayout& layout, const Pose* frames,
               double payload);
  /// Of a torque (motor side), or a moment about a frame or the base; in CoordinateLayout's order.
  void of(const Variable& load, Eigen::Ref<Eigen::RowVectorXd> gradient) const;

 private:
  struct Screw {
    Eigen::Vector3d axis, point;
    bool slides = false;
    int carries = 0;  // first body (0-based) that it moves
    int moves = 0;    // first frame that it moves
  };
  double change(int frame, const Eigen::Vector3d& axis, bool slides, const Screw& by) const;
  void add(int frame, const Eigen::Vector3d& axis, bool slides, double factor,
           Eigen::Ref<Eigen::RowVectorXd> gradient) const;

  const Robot& robot_;
  CoordinateLayout layout_;
  const Pose* frames_;
  std::vector<double> mass_;             // of body k and all beyond it, the payload last
  std::vector<Eigen::Vector3d> moment_;  // of the same: mass times position, in the base
};

}  // namespace armtrue
