// Residuals and analytic Jacobian of the unified model, row by row: columns of the geometric
// Jacobian times basis values.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

#include "fitter/common/parallel.h"
#include "fitter/design/carried_load.h"
#include "fitter/design/load_feedback.h"
#include "fitter/design/model.h"
#include "fitter/model/kinematics.h"
#include "fitter/model/measurements.h"

namespace armtrue {

/// Basis values of a model over a state, kept once: dense columns row-major, tables (hats) as
/// sparse rows.
class BasisTable {
 public:
  struct Entry {
    int parameter;   ///< into Model::parameters
    int coordinate;  ///< into CoordinateLayout
    double value;    ///< weight × basis
  };

  BasisTable(const Model& model, const State& state, const CoordinateLayout& layout);

  /// Re-evaluates the columns that depend on nonlinear parameters. `values` in Model::nonlinear's
  /// order.
  void set_nonlinear(const std::vector<double>& values);
  const std::vector<double>& nonlinear() const { return nonlinear_values_; }
  /// Re-evaluates the terms that read loads, after the loads of the state have changed.
  void update_loads();
  /// True if a term reads loads, so that the arm's deflection matters.
  bool reads_loads() const { return reads_loads_; }

  std::size_t rows() const { return rows_; }
  /// A variable of the state at every row, or the present value of a nonlinear parameter.
  const std::vector<double>& column(const std::string& name) const;
  /// Entries of one row that are not zero, appended to `entries` (cleared first).
  void row(std::size_t i, std::vector<Entry>& entries) const;
  /// As `row`, only for parameters whose basis contains a nonlinear parameter.
  void searched_row(std::size_t i, std::vector<Entry>& entries) const;
  bool is_searched(int parameter) const {
    return searched_parameter_[static_cast<std::size_t>(parameter)];
  }
  /// d(weight × basis)/d(nonlinear[j]) of one row, after make_slopes(); `parameter` is the
  /// coefficient that multiplies it.
  void nonlinear_row(std::size_t i, std::size_t j, std::vector<Entry>& entries) const;
  /// Computes what nonlinear_row reads, if it is out of date. Not thread-safe.
  void make_slopes() const;
  bool is_table(int parameter) const {
    return table_parameter_[static_cast<std::size_t>(parameter)];
  }

 private:
  struct DenseColumn {
    int parameter, coordinate;
    double weight;
    Expression basis = Expression::number(0.0);
    bool nonlinear = false, loads = false;
  };
  struct TableColumn {
    int parameter, coordinate;
    double weight;
    Expression basis = Expression::number(0.0);
  };
  struct SlopeColumn {
    int parameter, coordinate;
    std::size_t nonlinear;
    double weight;
    Expression basis = Expression::number(0.0);
    std::vector<double> values;
  };
  std::vector<double> evaluate(const Expression& expression) const;
  void fill_dense(std::size_t c);
  void fill_sparse();

  const State* state_;
  std::size_t rows_;
  std::vector<std::string> nonlinear_names_;
  std::vector<double> nonlinear_values_;
  std::vector<std::vector<double>> nonlinear_scalars_;
  std::vector<DenseColumn> dense_;
  std::vector<double> dense_values_;         // rows × dense_.size()
  mutable std::vector<SlopeColumn> slopes_;  // values are computed when first needed
  mutable bool slopes_stale_ = true;
  std::vector<TableColumn> tables_;
  std::vector<std::vector<Entry>> sparse_;
  bool reads_loads_ = false, tables_read_loads_ = false;
  std::vector<bool> table_parameter_, searched_parameter_;
};

/// Everything needed to evaluate a model against measurements. Unknowns are the free linear
/// parameters in order, then the nonlinear ones.
class Design {
 public:
  /// `kinematics` carries the base and tool reference poses and is copied. The other references
  /// must outlive the design.
  Design(const State& state, const Measurements& measurements, const Model& model,
         const Kinematics& kinematics);

  std::size_t rows() const { return measurements_->rows; }
  int residuals_per_row() const { return residuals_per_row_; }
  int unknowns() const { return static_cast<int>(free_.size()) + nonlinear_count(); }
  int nonlinear_count() const { return static_cast<int>(model_->nonlinear.size()); }
  const Model& model() const { return *model_; }
  const State& state() const { return *state_; }
  const Measurements& measurements() const { return *measurements_; }
  const Kinematics& kinematics() const { return kinematics_; }
  const BasisTable& basis() const { return basis_; }
  /// Parameters (indices into Model::parameters) that are unknowns, in order.
  const std::vector<int>& free_parameters() const { return free_; }
  /// Holds all other parameters at their present value. Fixed ones are never free.
  void set_free(const std::vector<int>& parameters);
  /// Unknown number of a parameter; −1 where it is held.
  int unknown_of(int parameter) const { return unknown_of_[static_cast<std::size_t>(parameter)]; }
  bool is_table_unknown(int unknown) const;
  int unknowns_beside_tables() const;

  /// Values of all linear parameters (held ones included); set_unknowns writes the free ones and
  /// the nonlinear ones.
  const std::vector<double>& values() const { return values_; }
  void set_values(const std::vector<double>& values) { values_ = values; }
  void set_unknowns(const double* unknowns);
  std::vector<double> unknown_values() const;
  /// Moves the loads of `state`, which the design reads, to the arm deflected by the present
  /// values; terms that follow a carried load follow it from now on. Returns how far their change
  /// moves a frame at most [m, or rad]; infinity if terms begin to follow.
  double stand(State& state);
  /// Whether predictions depend on loads, and so on the arm's deflection.
  bool reads_loads() const { return basis_.reads_loads(); }

  /// True after stand(): a change of coordinates then changes the loads too, in predictions and
  /// Jacobians.
  bool loads_follow() const { return feedback_.stands(); }
  /// A copy whose loads stay constant when coordinates change.
  Design with_loads_held() const;

  /// Row weights (square roots multiply the residual): 0 keeps a gross error out.
  std::vector<double>& weights() { return weights_; }
  const std::vector<double>& weights() const { return weights_; }

  /// One row of the Jacobian: the unknowns that it touches and a residuals × touched matrix.
  struct Row {
    std::vector<int> unknowns;
    Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian;  // top residuals_per_row() rows hold
    Eigen::Matrix<double, 6, 1> residual;
    Pose predicted = Pose::Identity();
  };
  /// Scratch memory of evaluate(), one for each thread.
  struct Workspace {
    explicit Workspace(const Design& design);
    Kinematics kinematics;
    std::vector<BasisTable::Entry> entries, slopes;
    std::vector<int> slot_of_unknown;
    Eigen::VectorXd coordinates, arm_coordinates;
    std::vector<double> carried;  // loads that terms follow
    // Derivatives of the last evaluated row's pose by the coordinates. `geometric`: with loads that
    // follow the arm; `direct`: with constant loads; `raw`: by the unknowns, not yet whitened.
    Eigen::Matrix<double, 6, Eigen::Dynamic> geometric, direct, raw;
  };
  /// Whitened, weighted residual (predicted − measured) and, if asked for, its Jacobian, which
  /// needs basis().make_slopes() before.
  void evaluate(std::size_t i, bool with_jacobian, Row& row, Workspace& workspace) const;
  /// The same with the design's own workspace: not thread-safe.
  void evaluate(std::size_t i, bool with_jacobian, Row& row);
  /// Evaluates every row on all processors and calls job(i, row, workspace): jobs must not change
  /// shared data.
  template <typename Job>
  void each_row(bool with_jacobian, const Job& job) const;
  /// Predicted pose of a row.
  Pose predict(std::size_t i);
  /// The geometric Jacobian (6 × coordinates) of the last row evaluated with the design's own
  /// workspace.
  const Eigen::Matrix<double, 6, Eigen::Dynamic>& geometric_jacobian() const {
    return own_.geometric;
  }
  /// Whitens a 6-vector change of row i's tool pose (position, rotation) the way the residual is
  /// whitened.
  Eigen::Matrix<double, 6, 1> whiten(std::size_t i,
                                     const Eigen::Matrix<double, 6, 1>& change) const;

 private:
  void coordinates_of(std::size_t i, Workspace& workspace) const;
  void differentiate(std::size_t i, Row& row, Workspace& workspace) const;

  const State* state_;
  const Measurements* measurements_;
  const Model* model_;
  Kinematics kinematics_;
  BasisTable basis_;
  CarriedLoads carried_;
  LoadFeedback feedback_;
  std::vector<bool> is_arms_;  // by parameter: belongs to the arm, so that it moves the loads
  int residuals_per_row_;
  std::vector<int> free_;
  std::vector<int> unknown_of_;
  std::vector<double> values_;
  std::vector<double> weights_;
  Workspace own_;
};

template <typename Job>
void Design::each_row(bool with_jacobian, const Job& job) const {
  // Evaluating fewer rows takes less time than starting a thread.
  constexpr std::size_t kTogether = 512;
  if (with_jacobian) basis_.make_slopes();
  in_pieces(rows(), kTogether, [&](std::size_t first, std::size_t end) {
    Workspace workspace(*this);
    Row row;
    for (std::size_t i = first; i < end; ++i) {
      evaluate(i, with_jacobian, row, workspace);
      job(i, row, workspace);
    }
  });
}

/// Predicted poses of a state with a fitted model: what `predict` does.
std::vector<Pose> predict_poses(const State& state, const std::vector<int>& target,
                                const Model& model, const Kinematics& kinematics);

}  // namespace armtrue
