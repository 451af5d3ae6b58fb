// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nanobind/stl/string.h>

#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "numpy.hpp"

namespace pilotage {

/// Specialised for each enumeration that a configuration holds: `list` of values and names.
template <typename Enum>
struct Names;
template <typename Enum>
const char* name_of(Enum value) {
  for (const auto& [candidate, name] : Names<Enum>::list) {
    if (candidate == value) return name;
  }
  return "?";
}

[[noreturn]] inline void refuse(const char* key, const std::string& value,
                                const std::string& allowed) {
  throw std::invalid_argument(std::string(key) + " = " + value + ": must be " + allowed);
}

inline std::string text_of(nb::handle value) { return nb::cast<std::string>(nb::str(value)); }

template <typename Enum>
Enum parse(const char* key, nb::handle value) {
  std::string allowed;
  for (const auto& [candidate, name] : Names<Enum>::list) {
    if (text_of(value) == name) return candidate;
    allowed += (allowed.empty() ? "one of " : ", ") + std::string(name);
  }
  refuse(key, text_of(value), allowed);
}

/// Writes each field of a configuration into a dict.
struct ToDict {
  nb::dict& out;
  template <typename T, typename... Rest>
  void operator()(const char* key, const T& member, Rest&&...) const {
    if constexpr (std::is_enum_v<T>) {
      out[key] = name_of(member);
    } else {
      out[key] = member;
    }
  }
};

/// Sets the field named `wanted`.
struct SetField {
  const std::string& wanted;
  nb::handle value;
  bool& found;

  template <typename T>
  void operator()(const char* key, T& member, const char*) const {
    if (wanted != key) return;
    found = true;
    if constexpr (std::is_enum_v<T>) {
      member = parse<T>(key, value);
    } else {
      if (!nb::isinstance<nb::bool_>(value)) refuse(key, text_of(value), "true or false");
      member = nb::cast<bool>(value);
    }
  }
  template <typename T, typename Bound>
  void operator()(const char* key, T& member, Bound low, Bound high, const char*) const {
    if (wanted != key) return;
    found = true;
    const std::string allowed =
        (std::is_integral_v<T> ? "a whole number from " : "a number from ") +
        text_of(nb::cast(low)) + " to " + text_of(nb::cast(high));
    const bool is_number = (nb::isinstance<nb::int_>(value) && !nb::isinstance<nb::bool_>(value)) ||
                           (!std::is_integral_v<T> && nb::isinstance<nb::float_>(value));
    double number = 0;
    if (!is_number || !nb::try_cast(value, number)) refuse(key, text_of(value), allowed);
    if (!(number >= static_cast<double>(low) && number <= static_cast<double>(high))) {
      refuse(key, text_of(value), allowed);
    }
    member = static_cast<T>(number);
  }
};

template <typename Config>
void set_field(Config& config, const std::string& key, nb::handle value) {
  bool found = false;
  Config::visit(config, SetField{key, value, found});
  if (found) return;
  std::string known;
  Config::visit(config, [&](const char* name, auto&&...) {
    known += (known.empty() ? "" : ", ") + std::string(name);
  });
  throw std::invalid_argument("unknown key " + key + "; known are " + known);
}

/// A class with a property for each field, `to_dict`, `from_dict` and `describe`.
template <typename Config>
void bind_config(nb::module_& m, const char* name, const char* doc) {
  nb::class_<Config> config(m, name, doc);
  config.def(nb::init<>())
      .def("to_dict",
           [](const Config& self) {
             nb::dict out;
             Config::visit(self, ToDict{out});
             return out;
           })
      .def_static(
          "from_dict",
          [](const nb::dict& values) {
            Config config;
            for (const auto& [key, value] : values) {
              set_field(config, nb::cast<std::string>(key), value);
            }
            return config;
          },
          nb::arg("values"),
          "The defaults with `values` changed; ValueError names a bad key or value.")
      .def("__setattr__", [](Config& self, const std::string& key,
                             nb::object value) { set_field(self, key, value); })
      .def_static("describe", [] {
        nb::dict out;
        Config defaults;
        Config::visit(defaults, [&](const char* key, auto&&, auto&&... rest) {
          out[key] = std::get<sizeof...(rest) - 1>(std::forward_as_tuple(rest...));
        });
        return out;
      });
  Config defaults;
  Config::visit(defaults, [&](const char* key, auto&&, auto&&... rest) {
    const std::string name = key;
    const auto get = [name](const Config& self) {
      nb::dict out;
      Config::visit(self, ToDict{out});
      return nb::object(out[name.c_str()]);
    };
    config.def_prop_ro(key, get, std::get<sizeof...(rest) - 1>(std::forward_as_tuple(rest...)));
  });
}

}  // namespace pilotage
