// The state of every measurement: recorded columns and the gravity loads computed from them. Names
// as in docs/model.md, section "State".
#pragma once

#include <Eigen/Core>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "fitter/model/expression/expression.h"
#include "fitter/model/robot.h"
#include "fitter/model/variable.h"

namespace armtrue {

/// Named columns over the rows of a data set. Recorded columns go in; gravity torques and moments
/// are computed when asked for.
class State {
 public:
  using Columns = std::map<std::string, std::vector<double>>;

  /// `columns` in the contract's names (q1…qn needed); `payload_point` in the flange [m]. Throws
  /// ModelError for missing joints or columns of unequal length.
  State(const Robot& robot, Columns columns, const Eigen::Vector3d& payload_point);

  std::size_t rows() const { return rows_; }
  const Robot& robot() const { return *robot_; }
  /// True where `name` is recorded or can be computed from what is.
  bool has(const std::string& name) const;
  /// True where the column stands in the data file.
  bool recorded(const std::string& name) const { return columns_.contains(name); }
  /// True where gravity torques follow from the links' masses; a recorded torque is used where they
  /// do not.
  bool computes_torque() const { return !robot_->links.empty(); }
  /// Name of the column that gives the direction of a joint's motion from the previous row, in
  /// order of time: its direction of approach if the arm went straight from row to row. Only the
  /// search for structure may read it, because the values change with the rows of the file.
  static std::string motion_of(int joint) { return "motion_" + std::to_string(joint); }
  /// The column of a state variable; throws ModelError naming the column to record if it is
  /// missing.
  const std::vector<double>& column(const std::string& name) const;
  /// Values of an expression of state variables, row by row.
  std::vector<double> values(const Expression& basis) const;
  /// All recorded columns.
  const Columns& columns() const { return columns_; }
  /// Commanded joints, rows × n, row-major.
  const std::vector<double>& joints() const { return q_; }
  /// Sensors with a temperature column, in robot.yaml's order first.
  const std::vector<std::string>& sensors() const { return sensors_; }
  /// The payload's point in the flange [m].
  const Eigen::Vector3d& payload_point() const { return payload_point_; }
  /// Removes the sensors' scatter from recorded torques that replace computed gravity torques:
  /// scatter would attenuate every spring fitted to them. Uses all rows together, so it is for
  /// fits, not for predictions.
  void smooth_torques();
  /// Reading of the clock [s] from which the variable `time` counts; without a call zero. A fit
  /// sets that of its earliest row, and its predictions the fit's.
  void begin_time_at(double origin);
  double time_origin() const { return time_origin_; }
  /// Loads then act on the deflected arm: `frames` are, for each row, 1…n in the robot base, then
  /// the payload point's. Before, the loads are those of the nominal arm at commanded angles.
  void stand(std::vector<Pose> frames);
  /// False: loads stay those of the nominal arm at commanded angles, however far it deflects. In
  /// either case they are nominal until `stand` is called again.
  void let_loads_follow(bool follow);
  bool loads_follow() const { return loads_follow_; }
  /// The rows in the order in which they were measured: by time, where recorded.
  std::vector<std::size_t> measured_order() const;
  /// True if the values depend on the arm's deflection.
  bool is_load(const Expression& basis) const;

 private:
  using Frames = std::vector<Pose>;  // frame k in the base, k = 1…n, then the payload point's frame
  bool is_load(const Variable& v) const;
  void forget_loads();
  Frames frames_of_row(std::size_t row) const;
  const std::vector<double>& remember(const std::string& name, std::vector<double> values) const;
  // Names of columns of gravity's loads: those of joint or frame k end in k and `end`.
  struct LoadNames {
    std::string torque, moment_x, moment_y, base_x, base_y, end;
  };
  void compute_loads(const Eigen::Vector3d& gravity, const LoadNames& names) const;
  std::vector<double> smooth_torque(int joint, const std::vector<double>& measured) const;
  std::vector<double> link_angle(int joint) const;
  std::vector<double> motion(int joint) const;
  std::vector<double> warmth(const Variable& v) const;
  std::vector<double> compute_regressor(const Variable& asked) const;

  const Robot* robot_;
  std::size_t rows_ = 0;
  Columns columns_;
  std::vector<double> q_;
  std::vector<std::string> sensors_;
  Eigen::Vector3d payload_point_;
  double time_origin_ = 0.0;
  bool loads_follow_ = true;
  // Fits that run in parallel share one state, so derived_ is filled under a lock. A copy has its
  // own lock.
  struct Lock {
    Lock() = default;
    Lock(const Lock&) {}
    Lock& operator=(const Lock&) { return *this; }
    std::recursive_mutex mutex;
  };
  mutable Lock lock_;
  std::shared_ptr<const Frames> standing_;  // rows × (n + 1); none: nominal
  mutable std::map<std::string, std::vector<double>> derived_;
};

}  // namespace armtrue
