"""Random valid requests, planned as the service plans them, and every answer checked by code of its own.

robot → motion → scene → request: what is asked. trial: one request planned. check: whether the answer keeps
the contract. law: what a changed request must come to. report: the tables.
"""
