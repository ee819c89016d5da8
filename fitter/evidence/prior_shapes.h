// What a coefficient may be before anything is measured: the priors of a block's columns.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fitter/evidence/blocks.h"

namespace armtrue {

/// Prior shapes of a form whose columns stand at `first` of `width`. `displacement`: of the tool by
/// one unit of each column [m]. `known_size`: the largest displacement by a coefficient that the
/// fit has [m]: of what is there, as much as there is was to be expected. 0: none.
void add_shapes(const EvidenceForm& form, const Eigen::VectorXd& displacement, double known_size,
                Eigen::Index first, Eigen::Index width, std::vector<PriorShape>& shapes);

/// Prior shapes of a table, one for each correlation length that its nodes can resolve.
void add_table_shapes(const Block& form, bool is_joint, const Eigen::MatrixXd& columns,
                      const Linearization& linearization, std::vector<PriorShape>& shapes);

/// What an effect that carries a load gives, against that load over the campaign.
std::vector<Carrying> carrying_of(const EvidenceForm& form, const Fit& fit);

/// Brings wide blocks to an orthonormal basis of what their columns span, their shapes with them.
Eigen::MatrixXd compress(const Eigen::MatrixXd& columns, std::vector<PriorShape>& shapes);

}  // namespace armtrue
