// Priors of the coefficients of a block's columns.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/evidence/blocks.h"

namespace armtrue {

/// Prior shapes of a form whose columns begin at `first` of `width`. `displacement`: of the tool by
/// one unit of each column [m]. `known_size`: the largest displacement by a coefficient in the fit
/// [m], so that the priors include the size of an effect that was found; 0: none.
void add_shapes(const EvidenceForm& form, const Eigen::VectorXd& displacement, double known_size,
                Eigen::Index first, Eigen::Index width, std::vector<PriorShape>& shapes);

/// Prior shapes of a table, one for each correlation length that its nodes can resolve.
void add_table_shapes(const Block& form, bool is_joint, const Eigen::MatrixXd& columns,
                      const Linearization& linearization, std::vector<PriorShape>& shapes);

/// The terms of an effect that carries a load, compared with that load over all rows.
std::vector<Carrying> carrying_of(const EvidenceForm& form, const Fit& fit);

/// Replaces the columns of a wide block by an orthonormal basis of their span, and adapts `shapes`.
Eigen::MatrixXd compress(const Eigen::MatrixXd& columns, std::vector<PriorShape>& shapes);

}  // namespace armtrue
