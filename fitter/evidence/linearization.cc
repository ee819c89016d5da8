#include "fitter/evidence/linearization.h"

#include <algorithm>
#include <cmath>

#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

// A rejected row counts as a residual of this many standard deviations.
constexpr double kBoundedResidual = 3.0;
// With more unknowns than this, the nodes of joint tables are left out.
constexpr int kMostUnknowns = 400;

// Nodes of a table of one joint: their columns are many and sparse.
bool is_joint_table(const Design& design, int unknown) {
  if (!design.is_table_unknown(unknown)) return false;
  const int p = design.free_parameters()[static_cast<std::size_t>(unknown)];
  return design.model().parameters[static_cast<std::size_t>(p)].joints.size() == 1;
}

void bound_rejected_rows(Design& design) {
  Design::Row probe;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    if (design.weights()[i] > 0.0) continue;
    design.weights()[i] = 1.0;
    design.evaluate(i, false, probe);
    const double size = probe.residual.head(design.residuals_per_row()).norm();
    design.weights()[i] = std::pow(kBoundedResidual / std::max(size, kBoundedResidual), 2);
  }
}

// Linearization::by_other_loads; needs the residuals of `l`.
Eigen::VectorXd change_by_other_loads(const Fit& fit, const Linearization& l) {
  if (!fit.design().reads_loads()) return {};
  State state = fit.state();
  Design design(state, fit.measurements(), fit.model(), fit.kinematics());
  design.weights() = fit.design().weights();
  bound_rejected_rows(design);
  state.let_loads_follow(!state.loads_follow());
  design.stand(state);
  Eigen::VectorXd change = -l.residual;
  design.each_row(false, [&](std::size_t i, const Design::Row& row, const auto&) {
    change.segment(static_cast<Eigen::Index>(i) * l.height, l.height) +=
        row.residual.head(l.height);
  });
  return change;
}

}  // namespace

double Linearization::displacement(const Eigen::Ref<const Eigen::VectorXd>& column) const {
  double squares = 0.0;
  for (Eigen::Index at = 0; at < column.size(); at += height)
    squares += column.segment<3>(at).squaredNorm();
  return typical_sigma * std::sqrt(squares * height / static_cast<double>(column.size()));
}

Linearization linearize(Fit& fit) {
  Design& design = fit.design();
  Linearization l;
  l.height = design.residuals_per_row();
  l.poses = fit.measurements().poses;
  l.layout = fit.kinematics().layout();
  l.typical_sigma = fit.measurements().typical_sigma;
  for (const Joint& joint : fit.robot().joints) l.prismatic.push_back(joint.prismatic);
  if (fit.measurements().has_rotation()) l.sigma_rotation = fit.measurements().sigma_rotation;
  l.rotation_is_copied = fit.measurements().rotation_is_copied;
  const std::vector<double> weights = design.weights();
  bound_rejected_rows(design);
  const auto equations = static_cast<Eigen::Index>(design.rows()) * l.height;
  const auto unknowns = static_cast<std::size_t>(design.unknowns());
  std::vector<bool> is_node(unknowns);
  std::vector<Eigen::Index> column_of(unknowns);
  for (int u = 0; u < design.unknowns(); ++u) {
    const auto i = static_cast<std::size_t>(u);
    is_node[i] = is_joint_table(design, u);
    std::vector<int>& columns = is_node[i] ? l.node : l.unknown;
    column_of[i] = static_cast<Eigen::Index>(columns.size());
    columns.push_back(u);
  }
  if (design.unknowns() > kMostUnknowns) l.node.clear();
  l.jacobian = Eigen::MatrixXd::Zero(equations, static_cast<Eigen::Index>(l.unknown.size()));
  l.nodes = Eigen::MatrixXd::Zero(equations, static_cast<Eigen::Index>(l.node.size()));
  l.geometry.resize(equations, l.layout.size());
  l.translation.resize(equations, 3);
  l.residual.resize(equations);
  l.from_tables = Eigen::VectorXd::Zero(equations);
  for (std::vector<double>& axis : l.point) axis.resize(design.rows());
  const std::vector<double> values = design.unknown_values();
  design.each_row(true, [&](std::size_t i, const Design::Row& row, const auto& workspace) {
    const Eigen::Index at = static_cast<Eigen::Index>(i) * l.height;
    l.residual.segment(at, l.height) = row.residual.head(l.height);
    for (std::size_t c = 0; c < l.point.size(); ++c)
      l.point[c][i] = row.predicted.translation()[static_cast<Eigen::Index>(c)];
    for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
      const auto unknown = static_cast<std::size_t>(row.unknowns[u]);
      const auto column = row.jacobian.col(static_cast<Eigen::Index>(u)).head(l.height);
      if (!is_node[unknown]) {
        l.jacobian.col(column_of[unknown]).segment(at, l.height) = column;
        continue;
      }
      l.from_tables.segment(at, l.height) += column * values[unknown];
      if (!l.node.empty()) l.nodes.col(column_of[unknown]).segment(at, l.height) = column;
    }
    const auto& geometric = workspace.geometric;
    for (Eigen::Index c = 0; c < geometric.cols(); ++c)
      l.geometry.col(c).segment(at, l.height) = design.whiten(i, geometric.col(c)).head(l.height);
    for (int c = 0; c < 3; ++c) {
      l.translation.col(c).segment(at, l.height) =
          design.whiten(i, Eigen::Matrix<double, 6, 1>::Unit(c)).head(l.height);
    }
  });
  design.weights() = weights;
  const Eigen::Map<const Eigen::MatrixXd> by_row(l.residual.data(), l.height, equations / l.height);
  l.counted = equations_that_count(static_cast<double>(by_row.cols()), by_row.squaredNorm(),
                                   by_row.topRows<3>().squaredNorm());
  l.freedom = std::max(1.0, l.counted - fit.effective_unknowns());
  l.by_other_loads = change_by_other_loads(fit, l);
  return l;
}

}  // namespace armtrue
