// SPDX-License-Identifier: Apache-2.0
#include "reconstruction/walk_lengths.hpp"

#include <boost/test/unit_test.hpp>
#include <cmath>

namespace pilotage {
namespace {

using boost::test_tools::tolerance;

BOOST_AUTO_TEST_CASE(nothing_known_of_lengths_is_nothing) {
  BOOST_TEST(!combined_length({}).has_value());
}

BOOST_AUTO_TEST_CASE(one_source_is_taken_as_it_is) {
  const auto length = combined_length({{LengthSource::ground, 1.07, 0.02, 40}});
  BOOST_REQUIRE(length.has_value());
  BOOST_TEST(length->factor == 1.07, tolerance(1e-12));
  BOOST_TEST(length->sigma == 0.02, tolerance(1e-12));
  BOOST_TEST(length->count == 40);
}

BOOST_AUTO_TEST_CASE(sources_count_by_their_variances) {
  // Four times the weight, for half the standard error; apart by less than both.
  const auto length = combined_length(
      {{LengthSource::joints, 1.00, 0.01, 60}, {LengthSource::steps, 1.02, 0.02, 5}});
  BOOST_REQUIRE(length.has_value());
  BOOST_TEST(length->factor == 1.004, tolerance(1e-12));
  BOOST_TEST(length->sigma == 1 / std::sqrt(1e4 + 2500), tolerance(1e-12));
  BOOST_TEST(length->count == 65);
}

BOOST_AUTO_TEST_CASE(sources_that_contradict_make_lengths_less_sure) {
  const auto length = combined_length(
      {{LengthSource::joints, 1.0, 0.01, 60}, {LengthSource::ground, 1.2, 0.01, 50}});
  BOOST_REQUIRE(length.has_value());
  BOOST_TEST(length->factor == 1.1, tolerance(1e-12));
  // As far as they are from their mean: neither is believed to be right.
  BOOST_TEST(length->sigma == 0.1, tolerance(1e-9));
}

}  // namespace
}  // namespace pilotage
