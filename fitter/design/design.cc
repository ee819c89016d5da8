#include "fitter/design/design.h"

#include <cmath>
#include <functional>
#include <limits>

#include "fitter/common/observer.h"
#include "fitter/design/stance.h"

namespace armtrue {

// --- BasisTable
// ------------------------------------------------------------------------------------------------------

BasisTable::BasisTable(const Model& model, const State& state, const CoordinateLayout& layout)
    : state_(&state),
      rows_(state.rows()),
      sparse_(state.rows()),
      table_parameter_(model.parameters.size(), false),
      searched_parameter_(model.parameters.size(), false) {
  for (const NonlinearParameter& p : model.nonlinear) {
    nonlinear_names_.push_back(p.name);
    nonlinear_values_.push_back(p.value);
    nonlinear_scalars_.push_back({p.value});
  }
  for (std::size_t index = 0; index < model.parameters.size(); ++index) {
    for (const Term& term : model.parameters[index].terms) {
      const int coordinate = layout.index(term.coordinate);
      const bool loads = state.is_load(term.basis);
      reads_loads_ = reads_loads_ || loads;
      if (term.table) {
        table_parameter_[index] = true;
        tables_read_loads_ = tables_read_loads_ || loads;
        tables_.push_back({static_cast<int>(index), coordinate, term.weight, term.basis});
        continue;
      }
      DenseColumn column{
          static_cast<int>(index), coordinate, term.weight, term.basis, false, loads};
      const std::set<std::string> used = term.basis.variables();
      for (std::size_t j = 0; j < nonlinear_names_.size(); ++j) {
        if (!used.contains(nonlinear_names_[j])) continue;
        column.nonlinear = true;
        searched_parameter_[index] = true;
        slopes_.push_back({static_cast<int>(index), coordinate, j, term.weight, term.basis, {}});
      }
      dense_.push_back(std::move(column));
    }
  }
  fill_sparse();
  dense_values_.resize(rows_ * dense_.size());
  for (std::size_t c = 0; c < dense_.size(); ++c) {
    fill_dense(c);
    for (std::size_t i = 0; i < rows_; ++i) {
      if (dense_[c].nonlinear || std::isfinite(dense_values_[i * dense_.size() + c])) continue;
      throw ModelError("model: term '" + dense_[c].basis.to_string() + "' of " +
                       model.parameters[static_cast<std::size_t>(dense_[c].parameter)].name +
                       " is not finite at measurement " + std::to_string(i + 1));
    }
  }
}

const std::vector<double>& BasisTable::column(const std::string& name) const {
  for (std::size_t j = 0; j < nonlinear_names_.size(); ++j) {
    if (nonlinear_names_[j] == name) return nonlinear_scalars_[j];
  }
  return state_->column(name);
}

std::vector<double> BasisTable::evaluate(const Expression& expression) const {
  return expression.evaluate(rows_, std::bind_front(&BasisTable::column, this));
}

void BasisTable::fill_dense(std::size_t c) {
  const std::vector<double> values = evaluate(dense_[c].basis);
  for (std::size_t i = 0; i < rows_; ++i)
    dense_values_[i * dense_.size() + c] = dense_[c].weight * values[i];
}

void BasisTable::fill_sparse() {
  for (std::vector<Entry>& entries : sparse_) entries.clear();
  for (const TableColumn& column : tables_) {
    const std::vector<double> values = evaluate(column.basis);
    for (std::size_t i = 0; i < rows_; ++i) {
      if (values[i] != 0.0)
        sparse_[i].push_back({column.parameter, column.coordinate, column.weight * values[i]});
    }
  }
}

void BasisTable::set_nonlinear(const std::vector<double>& values) {
  nonlinear_values_ = values;
  for (std::size_t j = 0; j < values.size(); ++j) nonlinear_scalars_[j] = {values[j]};
  for (std::size_t c = 0; c < dense_.size(); ++c) {
    if (dense_[c].nonlinear) fill_dense(c);
  }
  slopes_stale_ = true;
}

void BasisTable::update_loads() {
  for (std::size_t c = 0; c < dense_.size(); ++c) {
    if (dense_[c].loads) fill_dense(c);
  }
  if (tables_read_loads_) fill_sparse();
  slopes_stale_ = true;
}

void BasisTable::make_slopes() const {
  if (!slopes_stale_) return;
  for (SlopeColumn& slope : slopes_) {
    slope.values = slope.basis.slopes(rows_, std::bind_front(&BasisTable::column, this),
                                      nonlinear_names_[slope.nonlinear]);
    for (double& v : slope.values) v *= slope.weight;
  }
  slopes_stale_ = false;
}

void BasisTable::row(std::size_t i, std::vector<Entry>& entries) const {
  entries.clear();
  const double* values = dense_values_.data() + i * dense_.size();
  for (std::size_t c = 0; c < dense_.size(); ++c) {
    if (values[c] != 0.0) entries.push_back({dense_[c].parameter, dense_[c].coordinate, values[c]});
  }
  entries.insert(entries.end(), sparse_[i].begin(), sparse_[i].end());
}

void BasisTable::searched_row(std::size_t i, std::vector<Entry>& entries) const {
  entries.clear();
  for (std::size_t c = 0; c < dense_.size(); ++c) {
    if (is_searched(dense_[c].parameter)) {
      entries.push_back(
          {dense_[c].parameter, dense_[c].coordinate, dense_values_[i * dense_.size() + c]});
    }
  }
}

void BasisTable::nonlinear_row(std::size_t i, std::size_t j, std::vector<Entry>& entries) const {
  entries.clear();
  for (const SlopeColumn& slope : slopes_) {
    if (slope.nonlinear == j)
      entries.push_back({slope.parameter, slope.coordinate, slope.values[i]});
  }
}

// --- Design
// ----------------------------------------------------------------------------------------------------------

Design::Workspace::Workspace(const Design& design)
    : kinematics(design.kinematics_),
      coordinates(Eigen::VectorXd::Zero(design.kinematics_.layout().size())),
      arm_coordinates(coordinates),
      carried(design.carried_.loads()) {}

Design::Design(const State& state, const Measurements& measurements, const Model& model,
               const Kinematics& kinematics)
    : state_(&state),
      measurements_(&measurements),
      model_(&model),
      kinematics_(kinematics),
      basis_(model, state, kinematics.layout()),
      carried_(model, kinematics.layout(), state),
      feedback_(model, kinematics.layout(), state),
      residuals_per_row_(measurements.residuals_per_row()),
      weights_(measurements.rows, 1.0),
      own_(*this) {
  for (const Parameter& p : model.parameters) is_arms_.push_back(p.exported);
  std::vector<int> all;
  for (std::size_t i = 0; i < model.parameters.size(); ++i) {
    values_.push_back(model.parameters[i].value);
    all.push_back(static_cast<int>(i));
  }
  set_free(all);
}

void Design::set_free(const std::vector<int>& parameters) {
  free_.clear();
  unknown_of_.assign(model_->parameters.size(), -1);
  for (const int p : parameters) {
    if (model_->parameters[static_cast<std::size_t>(p)].fixed) continue;
    unknown_of_[static_cast<std::size_t>(p)] = static_cast<int>(free_.size());
    free_.push_back(p);
  }
}

bool Design::is_table_unknown(int unknown) const {
  return unknown < static_cast<int>(free_.size()) &&
         basis_.is_table(free_[static_cast<std::size_t>(unknown)]);
}

int Design::unknowns_beside_tables() const {
  int count = 0;
  for (int u = 0; u < unknowns(); ++u) count += is_table_unknown(u) ? 0 : 1;
  return count;
}

void Design::set_unknowns(const double* unknowns) {
  for (std::size_t k = 0; k < free_.size(); ++k)
    values_[static_cast<std::size_t>(free_[k])] = unknowns[k];
  if (nonlinear_count() == 0) return;
  std::vector<double> nonlinear(unknowns + free_.size(),
                                unknowns + free_.size() + model_->nonlinear.size());
  if (nonlinear != basis_.nonlinear()) basis_.set_nonlinear(nonlinear);
}

std::vector<double> Design::unknown_values() const {
  std::vector<double> result;
  for (const int p : free_) result.push_back(values_[static_cast<std::size_t>(p)]);
  result.insert(result.end(), basis_.nonlinear().begin(), basis_.nonlinear().end());
  return result;
}

void Design::coordinates_of(std::size_t i, Workspace& w) const {
  basis_.row(i, w.entries);
  w.coordinates.setZero();
  const bool follows = feedback_.stands();
  if (follows) w.arm_coordinates.setZero();
  std::ranges::fill(w.carried, 0.0);
  const auto add = [&](std::size_t p, int coordinate, double value) {
    w.coordinates[coordinate] += values_[p] * value;
    if (follows && is_arms_[p]) w.arm_coordinates[coordinate] += values_[p] * value;
  };
  for (const BasisTable::Entry& e : w.entries) {
    const auto p = static_cast<std::size_t>(e.parameter);
    if (carried_.follows(p)) continue;
    add(p, e.coordinate, e.value);
    if (const int load = carried_.load_of(p); load >= 0)
      w.carried[static_cast<std::size_t>(load)] += values_[p] * e.value;
  }
  for (const CarriedLoads::Follower& f : carried_.followers())
    add(f.parameter, f.coordinate, f.ratio[i] * w.carried[f.load]);
  if (follows) feedback_.correct(i, values_, w.arm_coordinates, w.coordinates);
}

double Design::stand(State& state) {
  const bool begins = carried_.begin();
  const double moved = armtrue::stand(state, basis_, *model_, values_, kinematics_, &feedback_);
  return begins ? std::numeric_limits<double>::infinity() : moved;
}

Design Design::with_loads_held() const {
  Design held = *this;
  held.feedback_.clear();
  return held;
}

Pose Design::predict(std::size_t i) {
  coordinates_of(i, own_);
  const auto n = static_cast<std::size_t>(kinematics_.layout().joints);
  return own_.kinematics.forward(&state_->joints()[i * n], own_.coordinates.data(),
                                 measurements_->target[i]);
}

Eigen::Matrix<double, 6, 1> Design::whiten(std::size_t i,
                                           const Eigen::Matrix<double, 6, 1>& change) const {
  const double root = std::sqrt(weights_[i]);
  Eigen::Matrix<double, 6, 1> result = Eigen::Matrix<double, 6, 1>::Zero();
  result.head<3>() = root * (measurements_->whiten_position[i] * change.head<3>());
  if (residuals_per_row_ == 6)
    result.tail<3>() = root * measurements_->per_rotation(i) * change.tail<3>();
  return result;
}

// Writes the derivatives of the row's pose by the unknowns that it touches into w.raw.
void Design::differentiate(std::size_t i, Row& row, Workspace& w) const {
  const bool follows = feedback_.stands();
  const auto most = static_cast<Eigen::Index>(w.entries.size() + carried_.followers().size() +
                                              model_->nonlinear.size());
  if (w.raw.cols() < most) w.raw.resize(6, most);
  w.slot_of_unknown.resize(static_cast<std::size_t>(unknowns()), -1);
  const auto slot = [&](int unknown) {
    int& s = w.slot_of_unknown[static_cast<std::size_t>(unknown)];
    if (s < 0) {
      s = static_cast<int>(row.unknowns.size());
      row.unknowns.push_back(unknown);
      w.raw.col(s).setZero();
    }
    return s;
  };
  // Adds what a parameter's basis value changes: its coordinate and, if it carries a load, those of
  // the terms that follow this load.
  const auto add = [&](int s, std::size_t p, int coordinate, double value) {
    const bool is_direct = follows && !is_arms_[p];
    w.raw.col(s) += value * (is_direct ? w.direct : w.geometric).col(coordinate);
    const int load = carried_.load_of(p);
    if (load < 0) return;
    for (const CarriedLoads::Follower& f : carried_.followers()) {
      if (f.load == static_cast<std::size_t>(load))
        w.raw.col(s) += value * values_[f.parameter] * f.ratio[i] * w.geometric.col(f.coordinate);
    }
  };
  for (const BasisTable::Entry& e : w.entries) {
    const auto p = static_cast<std::size_t>(e.parameter);
    if (unknown_of_[p] >= 0 && !carried_.follows(p))
      add(slot(unknown_of_[p]), p, e.coordinate, e.value);
  }
  for (const CarriedLoads::Follower& f : carried_.followers()) {
    if (unknown_of_[f.parameter] >= 0)
      add(slot(unknown_of_[f.parameter]), f.parameter, f.coordinate,
          f.ratio[i] * w.carried[f.load]);
  }
  for (int j = 0; j < nonlinear_count(); ++j) {
    basis_.nonlinear_row(i, static_cast<std::size_t>(j), w.slopes);
    const int s = slot(static_cast<int>(free_.size()) + j);
    for (const BasisTable::Entry& e : w.slopes) {
      const auto p = static_cast<std::size_t>(e.parameter);
      add(s, p, e.coordinate, values_[p] * e.value);
    }
  }
  for (const int unknown : row.unknowns) w.slot_of_unknown[static_cast<std::size_t>(unknown)] = -1;
}

void Design::evaluate(std::size_t i, bool with_jacobian, Row& row) {
  if (with_jacobian) basis_.make_slopes();
  evaluate(i, with_jacobian, row, own_);
}

void Design::evaluate(std::size_t i, bool with_jacobian, Row& row, Workspace& w) const {
  throw_if_cancelled();
  coordinates_of(i, w);
  const auto n = static_cast<std::size_t>(kinematics_.layout().joints);
  const double* q = &state_->joints()[i * n];
  const int target = measurements_->target[i];
  row.predicted = with_jacobian ? w.kinematics.forward(q, w.coordinates.data(), target, w.geometric)
                                : w.kinematics.forward(q, w.coordinates.data(), target);
  const bool follows = with_jacobian && feedback_.stands();
  if (follows) {
    w.direct = w.geometric;
    feedback_.follow(i, values_, w.geometric);
  }

  Eigen::Matrix<double, 6, 1> error = Eigen::Matrix<double, 6, 1>::Zero();
  error.head<3>() =
      row.predicted.translation() - measurements_->position.col(static_cast<Eigen::Index>(i));
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  if (residuals_per_row_ == 6) {
    // Left perturbation: exp(dφ) · predicted changes the logarithm by J_l⁻¹(error) dφ, which is the
    // identity at the solution.
    const Eigen::Vector3d log =
        rotation_log(row.predicted.linear() * measurements_->rotation[i].transpose());
    error.tail<3>() = log;
    turn = left_jacobian(log).inverse();
  }
  row.residual = whiten(i, error);
  row.unknowns.clear();
  if (!with_jacobian) return;

  differentiate(i, row, w);
  const double root = std::sqrt(weights_[i]);
  const Eigen::Matrix3d whiten_position = root * measurements_->whiten_position[i];
  const Eigen::Matrix3d whiten_rotation =
      residuals_per_row_ == 6 ? Eigen::Matrix3d(root * measurements_->per_rotation(i) * turn)
                              : Eigen::Matrix3d::Zero();
  const auto touched = static_cast<Eigen::Index>(row.unknowns.size());
  row.jacobian.resize(6, touched);
  for (Eigen::Index s = 0; s < touched; ++s) {
    row.jacobian.col(s).head<3>().noalias() = whiten_position * w.raw.col(s).head<3>();
    if (residuals_per_row_ == 6)
      row.jacobian.col(s).tail<3>().noalias() = whiten_rotation * w.raw.col(s).tail<3>();
  }
}

std::vector<Pose> predict_poses(const State& state, const std::vector<int>& target,
                                const Model& model, const Kinematics& kinematics) {
  Kinematics chain = kinematics;
  const BasisTable basis(model, state, chain.layout());
  Eigen::VectorXd coordinates(chain.layout().size());
  std::vector<BasisTable::Entry> entries;
  std::vector<Pose> poses;
  const auto n = static_cast<std::size_t>(chain.layout().joints);
  for (std::size_t i = 0; i < state.rows(); ++i) {
    throw_if_cancelled();
    basis.row(i, entries);
    coordinates.setZero();
    for (const BasisTable::Entry& e : entries) {
      coordinates[e.coordinate] +=
          model.parameters[static_cast<std::size_t>(e.parameter)].value * e.value;
    }
    poses.push_back(chain.forward(&state.joints()[i * n], coordinates.data(), target[i]));
  }
  return poses;
}

}  // namespace armtrue
