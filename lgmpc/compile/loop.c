
EXPORT int lgmpc_evaluate(void** frame) {{
  double** base = (double**) frame[0];
  const long long* plan = (const long long*) frame[1];
  double** now = (double**) frame[2];
  long long k;
  int i;
  for (k = 0; k < plan[0]; ++k) {{
    for (i = 0; i < {arguments}; ++i) now[i] = base[i] + k * plan[1 + i];
    {name}_lanes((const double* const*) now, now + {n_in}, (double*) frame[3]);
  }}
  return 0;
}}
