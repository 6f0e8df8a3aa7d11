
#ifdef __GNUC__
  #define EXPORT __attribute__((visibility("default")))
#else
  #define EXPORT
#endif
{declarations}
EXPORT long long {name}_lanes_work(void) {{ return {n_w}; }}
EXPORT void {name}_lanes(const V* const* x, V* const* r, V* w) {{
{calls}
}}
